"""How far tissue that varies lets the displacement vary: draws, runs of a protocol, and what they say together."""

from inverse.monte_carlo.bands import analyse as analyse
from inverse.monte_carlo.runs import run_samples as run_samples
from inverse.monte_carlo.runs import stepwise_outcome as stepwise_outcome
from inverse.monte_carlo.runs import transient_outcome as transient_outcome
from inverse.monte_carlo.spreads import FIXED as FIXED
from inverse.monte_carlo.spreads import SPREADS as SPREADS
from inverse.monte_carlo.spreads import Spread as Spread
from inverse.monte_carlo.spreads import draw_factors as draw_factors
from inverse.monte_carlo.spreads import varied as varied
