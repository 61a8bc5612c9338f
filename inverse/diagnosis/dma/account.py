"""What a report says of a dynamic mechanical analysis and of the solids behind it."""

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from inverse.diagnosis.constants import FittedConstant
from inverse.diagnosis.dma.extended_fit import ExtendedFit
from inverse.diagnosis.dma.problem import DmaProblem
from inverse.diagnosis.where import Absorbed

_COLUMNS = (("M_0", "Pa"), ("M_inf", "Pa"), ("tau", "s"), ("alpha", "1"))
"""Constants of a sweep and their units."""


@dataclasses.dataclass(frozen=True)
class DmaAccount:
    """Of one data set and its fits.

    Attributes:
        problem: These.
        null: Constants of every sweep without causes, as `DmaProblem.constants`, in the noise that refits with causes
            begin from.
    """

    problem: DmaProblem
    null: Float[np.ndarray, "sweep 4"]

    @property
    def model(self) -> str:
        """Name of the solid."""
        return self.problem.model.name

    @property
    def sentence(self) -> str:
        """The solid and the data."""
        kind = "fractional" if self.problem.model.fractional else "conventional"
        return f"{kind} Zener solid at each of {len(self.problem.sweeps)} sweeps, {self.problem.rows} rows"

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed."""
        return self.problem.notes

    @property
    def stated_deviations(self) -> bool:
        """Whether the data give standard deviations."""
        return self.problem.stated_deviations

    def facts(self, with_causes: Mapping[str, ExtendedFit]) -> list[str]:
        """Nothing: a sweep has no features that everybody looks at."""
        del with_causes
        return []

    def links(self) -> tuple[Absorbed, ...]:
        """None: what may be wrong with a modulus is among the free forms."""
        return ()

    def describe(self, place: Absorbed) -> str:
        """Where the correction is largest, its sign and its size."""
        return _describe(self.problem, place)

    def constants(self, extended: ExtendedFit) -> list[FittedConstant]:
        """Those of every sweep without and with the extension, as it makes them where it changes the solid."""
        found = extended.constants
        for extension, strength in zip(extended.extensions, extended.strengths, strict=True):
            found = np.asarray(extension.cause.material(jnp.asarray(found), float(strength)))
        # The order of a conventional solid is no constant, unless a cause makes it one.
        has_order = self.problem.model.fractional or bool(np.any(found[:, 3] != 1.0))
        columns = _COLUMNS if has_order else _COLUMNS[:-1]
        values = np.stack([self.null, found], axis=-1).tolist()
        at_end = np.stack([self._at_end(self.null), self._at_end(extended.constants)], axis=-1).tolist()
        return [
            FittedConstant(name, unit, sweep.label, *values[row][place], *at_end[row][place])
            for row, sweep in enumerate(self.problem.sweeps)
            for place, (name, unit) in enumerate(columns)
        ]

    def _at_end(self, constants: Float[np.ndarray, "sweep 4"]) -> Bool[np.ndarray, "sweep 4"]:
        """Which constants the end of the fit's range sets, and not the data."""
        model, found = self.problem.model, np.zeros(constants.shape, dtype=bool)
        count = len(model.constants())
        for row, sweep in enumerate(self.problem.sweeps):
            found[row, :count] = [end is not None for end in model.ends(sweep.data, constants[row, :count])]
        return found


def _describe(problem: DmaProblem, place: Absorbed) -> str:
    """Where the correction is largest, its sign and its size, in words."""
    relative = (place.correction / problem.weights.ravel()).reshape(problem.weights.shape)
    row, coordinate = np.unravel_index(int(np.argmax(np.abs(relative))), relative.shape)
    frequency = float(problem.conditions.angular_frequency[row]) / (2.0 * np.pi)
    sweep = problem.sweeps[int(problem.conditions.sweep[row])]
    value = float(relative[row, coordinate])
    if coordinate == 0:
        percent = 100.0 * abs(np.expm1(value))
        size = f"the measured magnitude is {percent:.2g} % {'above' if value > 0 else 'below'} the model"
    else:
        size = f"the measured phase is {abs(1e3 * value):.2g} mrad {'above' if value > 0 else 'below'} the model"
    onset = _onset(problem, relative[:, coordinate])
    return f"{place.words}: {size} at most, at {frequency:.3g} Hz ({sweep.label}){onset}"


def _onset(problem: DmaProblem, relative: Float[np.ndarray, " row"]) -> str:
    """The lowest temperature at which the correction reaches half its largest size, if that is not the lowest."""
    sizes = [np.max(np.abs(relative[np.asarray(problem.conditions.sweep) == i])) for i in range(len(problem.sweeps))]
    large = [s.temperature_c for s, size in zip(problem.sweeps, sizes, strict=True) if size >= 0.5 * max(sizes)]
    lowest = min(s.temperature_c for s in problem.sweeps)
    above = [s.temperature_c for s in problem.sweeps if s.temperature_c >= min(large)]
    return f", from {min(large):.0f} degC on" if min(large) > lowest and 1 < len(above) == len(large) else ""
