"""What a report says of curves of displacement and of the simulation behind them."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.refit import HmiFit
from inverse.diagnosis.where import Absorbed


@dataclasses.dataclass(frozen=True)
class HmiAccount:
    """Of one data set and its fit.

    Attributes:
        problem: Data and simulation.
        null: The fit without causes.
    """

    problem: HmiDiagnosisProblem
    null: HmiFit

    @property
    def model(self) -> str:
        """Name of the model."""
        return "simulated sonication"

    @property
    def sentence(self) -> str:
        """The simulation and the data."""
        count = len(self.problem.program.start)
        return (
            f"the experiment's simulation with {count} constant{'s' if count > 1 else ''} fitted and a factor of each "
            f"of {len(self.problem.rows.labels)} sonications, {len(self.problem.rows)} readings"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        return self.problem.notes

    @property
    def stated_deviations(self) -> bool:
        """Whether the data give standard deviations."""
        return self.problem.rows.deviation is not None

    def describe(self, place: Absorbed) -> str:
        """Where the correction is largest, its sign and its size, and from where on it is there."""
        rows = self.problem.rows
        relative = place.correction / self.problem.weights
        row = int(np.argmax(np.abs(relative)))
        side = "above" if relative[row] > 0.0 else "below"
        return (
            f"{place.words}: the measured displacement is {100.0 * abs(relative[row]):.2g} % {side} the model at most, "
            f"at {rows.temperature[row]:.0f} degC in sonication {rows.labels[rows.sonication[row]]}"
            f"{self._onset(relative)}"
        )

    def _onset(self, relative: np.ndarray) -> str:
        temperature = self.problem.rows.temperature
        large = temperature[np.abs(relative) >= 0.5 * np.max(np.abs(relative))]
        above = temperature >= large.min()
        mostly = np.mean(np.abs(relative[above]) >= 0.25 * np.max(np.abs(relative)))
        return f", from {large.min():.0f} degC on" if large.min() > temperature.min() + 5.0 and mostly > 0.6 else ""

    def shift(self, extended: HmiFit) -> list[str]:
        """Constants without and with the extension."""
        parameters, places = self.problem.program.parameters, self.problem.program.constants
        before, after = (
            np.asarray(parameters.values(jnp.asarray(fit.unknowns[places]))) for fit in (self.null, extended)
        )
        lines = ["| constant | without | with it |", "| --- | ---: | ---: |"]
        return lines + [
            f"| {name} | {b:.4g} | {a:.4g} |" for name, b, a in zip(parameters.names, before, after, strict=True)
        ]
