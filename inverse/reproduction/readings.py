"""What each reading of the paper's silences gives: beam, lesion, edge, modulus and unit of liver's M_0.

All of them are computed by the same code; none is preferred because it agrees.
"""

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import GaussianBeam, suomi2016
from inverse.reproduction.bench import LESIONS, TEMPERATURES, Bench, Case

GAUSSIAN = GaussianBeam.of_widths(1.4e-3, 9e-3)
"""A beam in the place of the paper's, which states neither width nor intensity: 1.4 x 9 mm at -6 dB, 20 mm of liver."""

DEFAULT = Case()

Forces = Mapping[float, Float[Array, "rq zq"]]


@dataclasses.dataclass(frozen=True)
class Reading:
    """Displacement at every temperature of the protocol, read in one way.

    Attributes:
        beam: What pushes.
        case: What the solid is.
        percent: Displacement in percent of that at the first temperature, in the order of `TEMPERATURES`.
        first_displacement: At the first temperature [m], at the beam's own power.
    """

    beam: str
    case: Case
    percent: tuple[float, ...]
    first_displacement: float

    @property
    def misfit(self) -> float:
        """Root mean square difference from the values that the paper's text states [percent points]."""
        stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
        here = [self.at(temperature) for temperature in stated]
        return float(np.sqrt(np.mean((np.asarray(here) - np.asarray(list(stated.values()))) ** 2)))

    def at(self, temperature: float) -> float:
        """Percent at one of the temperatures [degC]."""
        return self.percent[TEMPERATURES.index(temperature)]


def all_cases() -> list[Case]:
    """Every lesion with each edge that it can have, as Young's moduli; other moduli and units with a linear edge."""
    shapes = [(lesion, edge) for lesion in ("table", "semi-axes") for edge in ("linear", "sharp")]
    shapes += [("dose", edge) for edge in ("linear", "sharp", "dose")]
    edges = [Case(lesion, edge) for lesion, edge in shapes]
    others = [("Young", "1.1 Pa"), ("shear", "1.1 kPa"), ("constrained", "1.1 kPa")]
    return edges + [Case(lesion, "linear", modulus, liver) for modulus, liver in others for lesion in LESIONS]


def beams(bench: Bench, pushing_power: float) -> dict[str, Forces]:
    """Force density at the Gauss points by beam and temperature [degC].

    Args:
        bench: The experiment.
        pushing_power: A power [W] at which a push moves tissue as far as the paper says; see `second_study`. The other
            nonlinear beam has the power that heats to 70 degC in 60 s.
    """
    heating = float(bench.heating.acoustic_power)
    mesh, focus = bench.settings.mesh, bench.settings.focus
    gaussian = {t: GAUSSIAN.force_density(bench.model, jnp.asarray(t), mesh=mesh, focus=focus) for t in TEMPERATURES}
    result: dict[str, Forces] = {
        "bowl, linear": {t: bench.linear(t).force for t in TEMPERATURES},
        "Gaussian 1.4 x 9 mm": gaussian,
    }
    for power in (heating, pushing_power):
        result[f"bowl, harmonics at {power:.0f} W"] = {t: bench.nonlinear(t, power).force for t in TEMPERATURES}
    return result


def all_readings(bench: Bench, pushes: Mapping[str, Forces]) -> list[Reading]:
    """Each case with each beam: one response of the solid serves all of them."""
    readings = []
    for case in all_cases():
        responses = {temperature: bench.response(case, temperature) for temperature in TEMPERATURES}
        readings += [reading(name, case, responses, forces) for name, forces in pushes.items()]
    return readings


def reading(beam: str, case: Case, responses: Forces, forces: Forces) -> Reading:
    """A reading from responses [m/(N/m^3)] and forces [N/m^3] by temperature [degC]."""
    displacement = [float(jnp.vdot(responses[t], forces[t])) for t in TEMPERATURES]
    percent = tuple(100.0 * each / displacement[0] for each in displacement)
    return Reading(beam, case, percent, displacement[0])


def find(readings: list[Reading], beam: str, case: Case = DEFAULT) -> Reading:
    """The one reading of a beam, whose name begins so, and a case."""
    (found,) = (each for each in readings if each.beam.startswith(beam) and each.case == case)
    return found
