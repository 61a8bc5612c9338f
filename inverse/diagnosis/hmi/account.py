"""What a report says of curves of displacement and of the simulation behind them."""

import dataclasses
import functools
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from inverse.diagnosis.constants import FittedConstant
from inverse.diagnosis.hmi.features import Curve, mismatches
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.links import absorbed_by_links
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.where import Absorbed


@dataclasses.dataclass(frozen=True)
class HmiAccount:
    """Of one data set and its fit.

    Attributes:
        problem: Data and simulation.
        null: The fit without causes.
        seed: Of what is drawn for it.
    """

    problem: HmiDiagnosisProblem
    null: HmiFit
    seed: int = 0

    @property
    def model(self) -> str:
        """Name of the model."""
        return "simulated sonication"

    @property
    def sentence(self) -> str:
        """The simulation and the data."""
        count, sonications = len(self.problem.program.start), len(self.problem.rows.labels)
        return (
            f"the experiment's simulation with {count} constant{'s' if count > 1 else ''} fitted and a factor of "
            f"{f'each of {sonications} sonications' if sonications > 1 else 'the sonication'}, "
            f"{len(self.problem.rows)} readings"
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        return self.problem.notes

    @property
    def stated_deviations(self) -> bool:
        """Whether the data give standard deviations."""
        return self.problem.rows.deviation is not None

    def facts(self, with_causes: Mapping[str, HmiFit]) -> list[str]:
        """Dip, peak and end of every curve, as measured, as simulated at the same readings, and with causes."""
        rows = self.problem.rows
        measured, simulated = self._curves(rows.log_displacement), self._simulated(self.null)
        others = {name: self._simulated(fit) for name, fit in with_causes.items()}
        lines = ["| sonication | | dip | peak | end |", "| --- | --- | ---: | ---: | ---: |"]
        kinds = {"measured": measured, "simulated": simulated, **{f"with {name}": one for name, one in others.items()}}
        for number, label in enumerate(rows.labels):
            lines += [f"| {label} | {kind} | {curves[number].cells()} |" for kind, curves in kinds.items()]
        # By residuals as they are: what fits make least is weighed in the noise of each.
        size = min(map(noise_size, (self.null, *with_causes.values()))) / float(np.median(self.problem.weights))
        sentences = mismatches(measured, simulated, others, size=size)
        return ["In percent of the coldest reading, and where:", "", *lines, "", *(f"- {one}" for one in sentences), ""]

    def links(self) -> tuple[Absorbed, ...]:
        """What a smooth correction in each link of the chain takes of the misfit, the most first."""
        return self._links

    @functools.cached_property
    def _links(self) -> tuple[Absorbed, ...]:
        return absorbed_by_links(self.null, self.problem.noise_family(), np.random.default_rng(self.seed))

    def _simulated(self, fit: HmiFit) -> list[Curve]:
        return self._curves(self.problem.rows.log_displacement - fit.of_readings / self.problem.weights)

    def _curves(self, log_displacement: Float[np.ndarray, " row"]) -> list[Curve]:
        rows, curves = self.problem.rows, []
        for number, label in enumerate(rows.labels):
            mine = np.flatnonzero(rows.sonication == number)
            mine = mine[np.argsort(rows.temperature[mine], kind="stable")]
            percent = 100.0 * np.exp(log_displacement[mine] - log_displacement[mine[0]])
            curves.append(Curve(label, rows.temperature[mine], percent))
        return curves

    def describe(self, place: Absorbed) -> str:
        """Where the correction is largest, its sign and its size, and from where on it is there."""
        rows = self.problem.rows
        logarithm = place.correction[: len(rows)] / self.problem.weights
        row = int(np.argmax(np.abs(logarithm)))
        side = "above" if logarithm[row] > 0.0 else "below"
        return (
            f"{place.words}: the measured displacement is {100.0 * abs(np.expm1(logarithm[row])):.2g} % {side} the "
            f"model at most, at {rows.temperature[row]:.0f} degC in sonication {rows.labels[rows.sonication[row]]}"
            f"{self._onset(logarithm)}"
        )

    def _onset(self, logarithm: Float[np.ndarray, " row"]) -> str:
        temperature = self.problem.rows.temperature
        large = temperature[np.abs(logarithm) >= 0.5 * np.max(np.abs(logarithm))]
        above = temperature >= large.min()
        mostly = np.mean(np.abs(logarithm[above]) >= 0.25 * np.max(np.abs(logarithm)))
        return f", from {large.min():.0f} degC on" if large.min() > temperature.min() + 5.0 and mostly > 0.6 else ""

    def constants(self, extended: HmiFit) -> list[FittedConstant]:
        """Those that are free, without and with the extension."""
        parameters, places = self.problem.program.parameters, self.problem.program.constants
        before, after = (
            np.asarray(parameters.values(jnp.asarray(fit.unknowns[places]))) for fit in (self.null, extended)
        )
        return [
            FittedConstant(name, unit, "", float(b), float(a))
            for (name, unit, _), b, a in zip(parameters.columns, before, after, strict=True)
        ]
