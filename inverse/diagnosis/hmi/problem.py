"""A set of curves of displacement as a diagnosis sees it: residuals of the fit, and their derivatives in everything."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from inverse.cores import side_by_side
from inverse.diagnosis.examination import DETECTABLE
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.correction import Correction
from inverse.diagnosis.hmi.courses import HmiRows
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.diagnosis.noise import Noise, noise_family, series
from inverse.diagnosis.screening import Alternative

_FARTHEST = 4.0
"""Plausible strengths beyond which no effect is followed."""
_SMALL = 1e-4
"""Plausible strengths that show how far an effect has to be followed."""


@dataclasses.dataclass(frozen=True)
class Effect(Alternative):
    """What a cause does about a fit.

    Attributes:
        reach: Strength that it was taken at, of its sign, in the cause's unit; or at a part of it, where there is no
            such tissue.
    """

    reach: float = 0.0


@dataclasses.dataclass(frozen=True)
class HmiDiagnosisProblem:
    """One data set, and the simulation of it.

    Attributes:
        rows: What was measured.
        program: The simulation.
        notes: What was assumed, for the report.
        correction: What the full simulation has more than the fast one, about a fit; added to every prediction.
        trust: What each reading's weight is multiplied by, because the simulation is not exact there; see `trusted`.
    """

    rows: HmiRows
    program: HmiProgram
    notes: tuple[str, ...] = ()
    correction: Correction | None = None
    trust: Float[np.ndarray, " row"] | None = None

    @property
    def weights(self) -> Float[np.ndarray, " row"]:
        """One over the relative standard deviation where the file gives it, else 1; less where trust is less."""
        trust = np.ones(len(self.rows)) if self.trust is None else self.trust
        return trust if self.rows.deviation is None else trust / self.rows.deviation

    def trusted(self, unknowns: Float[np.ndarray, " unknown"], size: float) -> "HmiDiagnosisProblem":
        """The same data, each reading weighed with what the mesh may be wrong by there beside its noise.

        Where a lesion is many times as stiff as liver, most of what yields is a shell thinner than an element: the
        hottest readings come out 1 to 3 % wrong, to either side from one temperature to the next, on any mesh that can
        be afforded (of refinement 1 to 4). In noise of 1 % that is no cause. (Curves of six development tissues without
        noise, fitted: 0.5 to 1.4 noise standard deviations are left in five, all readings together, 2.6 in one.)

        Args:
            unknowns: Of the fit.
            size: Of the noise, in units of what the file gives, or relative.
        """
        error = mesh_error(self.program.mesh_difference(unknowns), self.rows)
        noise = size * (np.ones(len(self.rows)) if self.rows.deviation is None else self.rows.deviation)
        # Where there is no such tissue on the other mesh, nothing is known.
        trust = 1.0 / np.sqrt(1.0 + np.where(np.isfinite(error), error / noise, 0.0) ** 2)
        return dataclasses.replace(self, trust=trust)

    @property
    def factors(self) -> Float[np.ndarray, "row sonication"]:
        """Derivative of the prediction in the logarithm of each sonication's factor."""
        return (self.rows.sonication[:, None] == np.arange(len(self.rows.labels))[None, :]).astype(float)

    def predict(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """Logarithm of what is reported, by the fast simulation as corrected, but for a factor of each sonication."""
        fast = self.program.predict(unknowns)
        return fast if self.correction is None else fast + self.correction(unknowns)

    def residuals(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """Measured less predicted, weighted, each sonication's factor not yet taken off."""
        return self.weights * (self.rows.log_displacement - self.predict(unknowns))

    def slopes(self, unknowns: Float[np.ndarray, " unknown"], which: Sequence[int]) -> Float[np.ndarray, "row which"]:
        """Derivative of the weighted prediction in some of the unknowns."""
        found = self.program.slopes(unknowns, which)
        if self.correction is not None:
            found = found + self.correction.slopes(which)
        return self.weights[:, None] * found

    def alternatives(
        self, unknowns: Float[np.ndarray, " unknown"], fitted: Float[np.ndarray, "datum p"], size: float
    ) -> list[Effect]:
        """Change of the weighted prediction with the strength of every cause in every shape, about a fit without it.

        By as strong an effect as is detected, not by the derivative: the displacement turns within a kelvin where a
        lesion begins to be felt, and effects that are just seen move the focus by more than that. In a set with
        `thermocouple-position` hidden at d' 4.5, t was 1.5 along the derivative and 3.9 along the effect itself, by the
        full simulation as by the fast one, which is the one that is asked. A cause that may have either sign is looked
        for along both of its effects.

        Args:
            unknowns: Of the fit.
            fitted: Derivatives in everything that was fitted, of the weighted prediction and of what is believed; see
                `HmiFit`.
            size: Of the noise, in units of the weights.
        """
        program = self.program
        believed = np.zeros((len(fitted) - len(self.rows), 1))
        basis = np.linalg.qr(fitted / np.maximum(np.linalg.norm(fitted, axis=0), 1e-300))[0]
        plain = program.predict(unknowns)

        def of_shape(which: tuple[int, float]) -> list[Effect]:
            place, shape = which
            cause, at = program.causes[place], unknowns.copy()
            at[len(program.causes) + place] = shape

            def taken_at(strength: float) -> Float[np.ndarray, "datum 1"]:
                change = self.weights * program.secant(at, place, strength, plain)
                return np.append(change[:, None], believed, axis=0)

            small = taken_at(_SMALL)
            length = float(np.linalg.norm(small - basis @ (basis.T @ small)))
            seen = DETECTABLE * size / max(length, 1e-300)
            reaches = [sign * min(seen, farthest(cause, sign)) for sign in (1, -1)[: 1 if cause.sign > 0 else 2]]
            return [
                # In the strength's own unit: the program counts in plausible strengths.
                Effect(
                    cause.name, taken_at(reach) / cause.plausible, 1 if reach > 0.0 else -1,
                    shape if len(cause.shapes) > 1 else None, reach * cause.plausible,
                )
                for reach in reaches
            ]  # fmt: skip

        shapes = [(place, shape) for place, cause in enumerate(program.causes) for shape in cause.shapes]
        return [effect for effects in side_by_side(of_shape, shapes) for effect in effects]

    def corrected_at(
        self, unknowns: Float[np.ndarray, " unknown"], moved: Int[np.ndarray, " moved"]
    ) -> "HmiDiagnosisProblem":
        """The same data, the fast simulation with value and derivatives of the full one at a fit.

        What the fast simulation leaves out is then no misfit of the model. Its curvature stays its own.

        Args:
            unknowns: Of the fit.
            moved: Places of those that were fitted.
        """
        value, columns = self.program.linearise(unknowns, moved.tolist())
        value = value - self.program.predict(unknowns)
        columns = columns - self.program.slopes(unknowns, moved.tolist())
        return dataclasses.replace(self, correction=Correction(unknowns.copy(), value, moved, columns))

    def left(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """What the full simulation has more than this one, weighted, each sonication's factor taken off."""
        difference = self.program.simulate(unknowns) - self.predict(unknowns)
        weighted = self.weights[:, None] * self.factors
        difference = self.weights * difference
        return difference - weighted @ np.linalg.lstsq(weighted, difference, rcond=None)[0]

    def noise_family(self) -> tuple[Noise, ...]:
        """Of readings, correlated in time in each sonication or larger from some temperature on; and of beliefs."""
        neighbours = series("time", self.rows.sonication.tolist(), self.rows.time)
        family = noise_family((neighbours,), self.rows.temperature, unit="degC")
        return tuple(one.extended(self.program.n_beliefs) for one in family)


def mesh_error(difference: Float[np.ndarray, " row"], rows: HmiRows) -> Float[np.ndarray, " row"]:
    """Relative standard deviation of what meshes differ by: of each reading and its neighbours in temperature.

    A difference common to all of a sonication is in its factor, and no error.
    """
    found = np.zeros(len(difference))
    for one in range(len(rows.labels)):
        mine = np.flatnonzero(rows.sonication == one)
        mine = mine[np.argsort(rows.temperature[mine], kind="stable")]
        square = (difference[mine] - np.median(difference[mine])) ** 2
        padded = np.pad(square, 1, mode="edge")
        found[mine] = np.sqrt((padded[:-2] + padded[1:-1] + padded[2:]) / 3.0)
    return found


def farthest(cause: HmiCause, sign: int) -> float:
    """How far from 0 an effect is followed to one side (1 or -1), in plausible strengths."""
    return min(_FARTHEST, cause.farthest(sign) / cause.plausible)
