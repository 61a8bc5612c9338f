"""Posteriors: a fast look, two samplers, the evidence, and whether draws can be trusted.

Laplace approximation -> walkers or chains -> `Draws` -> diagnostics, evidence, and a record for ArviZ and NetCDF.
"""

from inverse.sampling.autocorrelation import StopRule as StopRule
from inverse.sampling.autocorrelation import integrated_time as integrated_time
from inverse.sampling.compare import Comparison as Comparison
from inverse.sampling.compare import compare as compare
from inverse.sampling.diagnostics import Diagnostics as Diagnostics
from inverse.sampling.diagnostics import diagnose_draws as diagnose_draws
from inverse.sampling.draws import Draws as Draws
from inverse.sampling.ensemble import default_walkers as default_walkers
from inverse.sampling.ensemble import sample_ensemble as sample_ensemble
from inverse.sampling.ensemble import walkers_from_laplace as walkers_from_laplace
from inverse.sampling.ensemble import walkers_from_prior as walkers_from_prior
from inverse.sampling.evidence import Evidence as Evidence
from inverse.sampling.evidence import bridge_evidence as bridge_evidence
from inverse.sampling.importance import importance_evidence as importance_evidence
from inverse.sampling.importance import sample_importance as sample_importance
from inverse.sampling.inference_data import load_posterior as load_posterior
from inverse.sampling.inference_data import save_posterior as save_posterior
from inverse.sampling.laplace import Laplace as Laplace
from inverse.sampling.laplace import laplace as laplace
from inverse.sampling.nuts import sample_nuts as sample_nuts
from inverse.sampling.overlap import overlap_coefficient as overlap_coefficient
from inverse.sampling.rank_calibration import RankCalibration as RankCalibration
from inverse.sampling.rank_calibration import calibrate_ranks as calibrate_ranks
from inverse.sampling.record import left_out as left_out
from inverse.sampling.record import posterior_record as posterior_record
