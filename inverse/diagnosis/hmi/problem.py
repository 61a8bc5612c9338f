"""A set of curves of displacement as a diagnosis sees it: residuals of the fit, and their derivatives in everything."""

import copy
import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import Discretisation, FastCurve, Model
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.chain import Course, Courses, log_reported, together
from inverse.diagnosis.hmi.courses import HmiRows
from inverse.diagnosis.hmi.simulation import FastSimulation, FullSimulation
from inverse.diagnosis.noise import Ordering, series
from inverse.inference.parameter_set import ParameterSet
from inverse.inference.problem import State

_MORE_AT_ONCE = 2
"""Derivatives taken in one call of the compiled program beside those in the constants; fewer are filled up."""

_FLATTEST = 1e-3
"""Penalty a unit below which a prior is taken for flat."""


class HmiProgram:
    """The compiled simulation of one set of courses with all causes of a library in it.

    A cause that is not put in stays at strength 0, where it is nothing. What is compiled does not know the data, so
    that all data measured in the same states share it.

    Unknowns are strengths and shapes of the whole library, then the unconstrained constants of the model.
    """

    def __init__(
        self,
        curve: FastCurve,
        courses: Sequence[Course],
        parameters: ParameterSet,
        state: State,
        causes: Sequence[HmiCause],
        fine: Discretisation,
    ) -> None:
        """Prepare; compilation happens at the first use.

        Args:
            curve: The fast model.
            courses: Of all sonications.
            parameters: What is free in the model.
            state: The model that they are put into.
            causes: The library.
            fine: Of the full simulation, whose place the fast one takes.
        """
        self.causes, self.parameters = tuple(causes), parameters
        self.courses, self._stacked = tuple(courses), together(courses)
        self.start = np.asarray(parameters.start(state), dtype=float)
        scales = jnp.asarray([cause.plausible for cause in causes], dtype=float)
        count = len(self.causes)

        def parts(unknowns: Array):
            model = parameters.write(state, parameters.values(unknowns[2 * count :])).model
            extensions = tuple(Extension(cause, unknowns[count + i]) for i, cause in enumerate(self.causes))
            return model, extensions, unknowns[:count] * scales

        fast, full = FastSimulation(curve), FullSimulation(fine)

        def predict(courses: Courses, unknowns: Array) -> tuple[Array, Array]:
            return log_reported(fast, courses, *parts(unknowns))

        def simulate(courses: Courses, unknowns: Array) -> Array:
            return log_reported(full, courses, *parts(unknowns))[0]

        def penalties(unknowns: Array) -> Array:
            return parameters.penalties(parameters.values(unknowns[2 * count :]))

        def slopes(courses: Courses, unknowns: Array, directions: Array) -> Array:
            def one(direction: Array) -> Array:
                return jax.jvp(lambda at: predict(courses, at)[0], (unknowns,), (direction,))[1]

            return jax.vmap(one, out_axes=1)(directions)

        self._predict, self._slopes = eqx.filter_jit(predict), eqx.filter_jit(slopes)
        self._simulate = eqx.filter_jit(simulate)
        self._penalties, self._penalty_slopes = jax.jit(penalties), jax.jit(jax.jacfwd(penalties))
        self._model = lambda unknowns: parts(jnp.asarray(unknowns))[0]

    def on(self, courses: Sequence[Course]) -> "HmiProgram":
        """The same program on other courses; compiled anew only where they have other numbers of states."""
        other = copy.copy(self)
        other.courses, other._stacked = tuple(courses), together(courses)
        return other

    @property
    def n_rows(self) -> int:
        """That the courses predict."""
        return sum(len(course.rows) for course in self.courses)

    @property
    def n_unknowns(self) -> int:
        """Strengths, shapes and constants."""
        return 2 * len(self.causes) + len(self.start)

    @property
    def constants(self) -> np.ndarray:
        """Places of the model's constants among the unknowns."""
        return 2 * len(self.causes) + np.arange(len(self.start))

    @property
    def spreads(self) -> Float[np.ndarray, " constant"]:
        """Change of each unconstrained constant that takes it one standard deviation of its prior away."""
        slopes = self.penalty_slopes(self.null())[:, self.constants]
        return 1.0 / np.maximum(np.linalg.norm(slopes, axis=0), _FLATTEST)

    def null(self) -> Float[np.ndarray, " unknown"]:
        """Unknowns without any cause, at the priors' middle."""
        return np.concatenate([np.zeros(len(self.causes)), [cause.shapes[0] for cause in self.causes], self.start])

    def place(self, name: str) -> int:
        """Place of a cause's strength among the unknowns; its shape is as many causes later.

        Raises:
            KeyError: if the library has no such cause.
        """
        for index, cause in enumerate(self.causes):
            if cause.name == name:
                return index
        raise KeyError(f"the library has no cause {name}")

    def predict(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """Logarithm of what is reported for every row, but for a factor of each sonication."""
        found = np.zeros(self.n_rows)
        for courses, rows in self._stacked:
            found[rows] = self._predict(courses, jnp.asarray(unknowns))[0]
        return found

    def slopes(self, unknowns: Float[np.ndarray, " unknown"], which: Sequence[int]) -> Float[np.ndarray, "row which"]:
        """Derivative of the prediction in some of the unknowns."""
        found, count = [], len(self.start) + _MORE_AT_ONCE
        for first in range(0, len(which), count):
            part = list(which[first : first + count])
            directions = np.zeros((count, self.n_unknowns))
            directions[np.arange(len(part)), part] = 1.0
            columns = np.zeros((self.n_rows, count))
            for courses, rows in self._stacked:
                columns[rows] = self._slopes(courses, jnp.asarray(unknowns), jnp.asarray(directions))
            found.append(columns[:, : len(part)])
        return np.concatenate(found, axis=1) if found else np.zeros((0, 0))

    def simulate(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """What the full simulation has in place of `predict`: seconds."""
        found = np.zeros(self.n_rows)
        for courses, rows in self._stacked:
            found[rows] = self._simulate(courses, jnp.asarray(unknowns))
        return found

    def penalties(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " penalty"]:
        """Distances of the constants from their priors' middle, in standard deviations."""
        return np.asarray(self._penalties(jnp.asarray(unknowns)))

    def penalty_slopes(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "penalty unknown"]:
        """Their derivatives in the unknowns."""
        return np.asarray(self._penalty_slopes(jnp.asarray(unknowns)))

    def excess(self, unknowns: Float[np.ndarray, " unknown"]) -> float:
        """How far the farthest state lies outside of what the fast model was trained on, above 1; covered up to 1."""
        return max(float(self._predict(courses, jnp.asarray(unknowns))[1]) for courses, _ in self._stacked)

    def model(self, unknowns: Float[np.ndarray, " unknown"]) -> Model:
        """The model with the constants put in; causes are not in it."""
        return self._model(unknowns)


@dataclasses.dataclass(frozen=True)
class HmiDiagnosisProblem:
    """One data set, and the simulation of it.

    Attributes:
        rows: What was measured.
        program: The simulation.
        correction: Logarithm of the full simulation over the fast one where the fit is, added to every prediction.
        notes: What was assumed, for the report.
    """

    rows: HmiRows
    program: HmiProgram
    correction: Float[np.ndarray, " row"]
    notes: tuple[str, ...] = ()

    @property
    def weights(self) -> Float[np.ndarray, " row"]:
        """One over the relative standard deviation where the file gives it, else 1."""
        return np.ones(len(self.rows)) if self.rows.deviation is None else 1.0 / self.rows.deviation

    @property
    def factors(self) -> Float[np.ndarray, "row sonication"]:
        """Derivative of the prediction in the logarithm of each sonication's factor."""
        return (self.rows.sonication[:, None] == np.arange(len(self.rows.labels))[None, :]).astype(float)

    def residuals(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """Measured less predicted, weighted, each sonication's factor not yet taken off."""
        return self.weights * (self.rows.log_displacement - self.program.predict(unknowns) - self.correction)

    def slopes(self, unknowns: Float[np.ndarray, " unknown"], which: Sequence[int]) -> Float[np.ndarray, "row which"]:
        """Derivative of the weighted prediction in some of the unknowns."""
        return self.weights[:, None] * self.program.slopes(unknowns, which)

    def corrected_at(self, unknowns: Float[np.ndarray, " unknown"]) -> "HmiDiagnosisProblem":
        """The same data, the fast simulation corrected to the full one at a fit.

        What the fast simulation leaves out is then no misfit of the model, as far as it does not change about there.
        """
        difference = self.program.simulate(unknowns) - self.program.predict(unknowns)
        # A factor of each sonication is free, so that only the course counts.
        factors = np.linalg.lstsq(self.factors, difference, rcond=None)[0]
        return dataclasses.replace(self, correction=difference - self.factors @ factors)

    def orderings(self) -> tuple[Ordering, ...]:
        """Neighbours in time within each sonication."""
        return (series("time", self.rows.sonication.tolist(), self.rows.time),)

    def coordinate(self) -> Float[np.ndarray, " row"]:
        """Along which the noise may step [degC]."""
        return self.rows.temperature
