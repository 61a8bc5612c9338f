"""The compiled simulation of a set of courses, fast and full, with the derivatives of both."""

import copy
import functools
import math
from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from arfjax import Discretisation, FastCurve, Model
from arfjax.numerics.batches import map_in_batches
from arfjax.numerics.compiled import compiled
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.chain import Course, Courses, log_reported, together
from inverse.diagnosis.hmi.simulation import FastSimulation, FullSimulation
from inverse.inference.parameter_set import ParameterSet
from inverse.inference.problem import State

_MORE_AT_ONCE = 2
"""Derivatives taken in one call of the compiled program beside those in the constants; fewer are filled up."""

_DIRECTIONS_AT_ONCE = 4
"""With more of them the tangents of the thermal dose fill the cache; one by one takes half as long again."""

_FLATTEST = 1e-3
"""Penalty a unit below which a prior is taken for flat."""
_LOGISTIC = math.pi / math.sqrt(3.0)
"""Standard deviation of the unconstrained number of a constant that is as likely anywhere in its range."""
_HALVINGS = 6


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
        finer: Discretisation | None = None,
    ) -> None:
        """Prepare; compilation happens at the first use.

        Args:
            curve: The fast model.
            courses: Of all sonications.
            parameters: What is free in the model.
            state: The model that they are put into.
            causes: The library.
            fine: Of the full simulation, whose place the fast one takes.
            finer: That tells how far the mesh of that is wrong; nothing is known of it without.
        """
        self.causes, self.parameters = tuple(causes), parameters
        self.courses, self._stacked = tuple(courses), together(courses)
        self._simulated, self._others = (curve, state, fine, finer), dict[tuple[HmiCause, ...], HmiProgram]()
        self.start = np.asarray(parameters.start(state), dtype=float)
        scales = jnp.asarray([cause.plausible for cause in causes], dtype=float)
        count = len(self.causes)

        def parts(unknowns: Array):
            model = parameters.write(state, parameters.values(unknowns[2 * count :])).model
            extensions = tuple(Extension(cause, unknowns[count + i]) for i, cause in enumerate(self.causes))
            return model, extensions, unknowns[:count] * scales

        fast, full = FastSimulation(curve), FullSimulation(fine)

        def predict(courses: Courses, unknowns: Array) -> tuple[Array, Array, Array]:
            return log_reported(fast, courses, *parts(unknowns))

        def simulate(courses: Courses, unknowns: Array) -> Array:
            return log_reported(full, courses, *parts(unknowns))[0]

        def simulate_finer(courses: Courses, unknowns: Array) -> Array:
            return log_reported(FullSimulation(fine if finer is None else finer), courses, *parts(unknowns))[0]

        def linearise(courses: Courses, unknowns: Array, directions: Array) -> tuple[Array, Array]:
            return _linearised(lambda at: simulate(courses, at), unknowns, directions)

        def penalties(unknowns: Array) -> Array:
            return parameters.penalties(parameters.values(unknowns[2 * count :]))

        def slopes(courses: Courses, unknowns: Array, directions: Array) -> Array:
            return _linearised(lambda at: predict(courses, at)[0], unknowns, directions)[1]

        self._predict, self._slopes = compiled(predict), compiled(slopes)
        self._simulate, self._simulate_finer = compiled(simulate), compiled(simulate_finer)
        self._linearise = compiled(linearise)
        self._penalties, self._penalty_slopes = jax.jit(penalties), jax.jit(jax.jacfwd(penalties))
        self._model = lambda unknowns: parts(jnp.asarray(unknowns))[0]

    def on(self, courses: Sequence[Course]) -> "HmiProgram":
        """The same program on other courses; compiled anew only where they have other numbers of states."""
        other = copy.copy(self)
        other.courses, other._stacked = tuple(courses), together(courses)
        return other

    def with_causes(self, causes: Sequence[HmiCause]) -> "HmiProgram":
        """The same courses with other causes, compiled once for all programs that are this one `on` other courses."""
        causes = tuple(causes)
        if causes not in self._others:
            curve, state, fine, finer = self._simulated
            self._others[causes] = HmiProgram(curve, self.courses, self.parameters, state, causes, fine, finer)
        return self._others[causes].on(self.courses)

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

    @functools.cached_property
    def spreads(self) -> Float[np.ndarray, " constant"]:
        """Change of each unconstrained constant that takes it one standard deviation of its prior away."""
        lengths = np.linalg.norm(self.penalty_slopes(self.null())[:, self.constants], axis=0)
        return np.where(lengths > _FLATTEST, 1.0 / np.maximum(lengths, _FLATTEST), _LOGISTIC)

    @functools.cached_property
    def _believed(self) -> Bool[np.ndarray, " all_penalties"]:
        """Which of the penalties there are; of a flat prior there is none."""
        slopes = np.asarray(self._penalty_slopes(jnp.asarray(self.null())))
        return np.linalg.norm(slopes, axis=1) > _FLATTEST

    @property
    def n_beliefs(self) -> int:
        """How many constants something is believed of."""
        return int(np.sum(self._believed))

    @property
    def names_of_beliefs(self) -> tuple[str, ...]:
        """Of these constants."""
        return tuple(name for name, any_is in zip(self.parameters.names, self._believed, strict=True) if any_is)

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

    def coldest_displacement(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """Displacement [m] of the coldest state of each row's sonication, in the fast simulation."""
        found = np.zeros(self.n_rows)
        for courses, rows in self._stacked:
            found[rows] = self._predict(courses, jnp.asarray(unknowns))[2]
        return found

    def slopes(self, unknowns: Float[np.ndarray, " unknown"], which: Sequence[int]) -> Float[np.ndarray, "row which"]:
        """Derivative of the prediction in some of the unknowns."""
        found = [np.zeros((self.n_rows, 0))]
        for directions, count in self._directions(which):
            columns = np.zeros((self.n_rows, len(directions)))
            for courses, rows in self._stacked:
                columns[rows] = self._slopes(courses, jnp.asarray(unknowns), directions)
            found.append(columns[:, :count])
        return np.concatenate(found, axis=1)

    def secant(
        self, unknowns: Float[np.ndarray, " unknown"], place: int, strength: float, plain: Float[np.ndarray, " row"]
    ) -> Float[np.ndarray, " row"]:
        """Change of the prediction with a strength, over that strength; of a smaller one where there is no such tissue.

        Args:
            unknowns: Without the strength.
            place: Of the strength.
            strength: In plausible ones; the derivative where it is 0.
            plain: The prediction without it.
        """
        for _ in range(_HALVINGS if strength else 0):
            at = unknowns.copy()
            at[place] += strength
            change = (self.predict(at) - plain) / strength
            if np.all(np.isfinite(change)):
                return change
            strength *= 0.5
        return self.slopes(unknowns, [place])[:, 0]

    def simulate(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """What the full simulation has in place of `predict`: seconds."""
        found = np.zeros(self.n_rows)
        for courses, rows in self._stacked:
            found[rows] = self._simulate(courses, jnp.asarray(unknowns))
        return found

    def mesh_difference(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " row"]:
        """What a finer mesh changes in the full simulation; 0 if none was given. Three simulations long."""
        if self._simulated[3] is None:
            return np.zeros(self.n_rows)
        found = np.zeros(self.n_rows)
        for courses, rows in self._stacked:
            found[rows] = self._simulate_finer(courses, jnp.asarray(unknowns))
        return found - self.simulate(unknowns)

    def linearise(
        self, unknowns: Float[np.ndarray, " unknown"], which: Sequence[int]
    ) -> tuple[Float[np.ndarray, " row"], Float[np.ndarray, "row which"]]:
        """Value of the full simulation and its derivative in some of the unknowns.

        In however many up to two more than there are constants it takes about twice as long as the value alone.
        """
        value, found = np.zeros(self.n_rows), []
        for directions, count in self._directions(which):
            columns = np.zeros((self.n_rows, len(directions)))
            for courses, rows in self._stacked:
                value[rows], columns[rows] = self._linearise(courses, jnp.asarray(unknowns), directions)
            found.append(columns[:, :count])
        return value, np.concatenate(found, axis=1)

    def _directions(self, which: Sequence[int]) -> Iterator[tuple[Float[Array, "direction unknown"], int]]:
        """Unit vectors, as many at a time as one call of a compiled program takes, and how many of them were wanted."""
        count = len(self.start) + _MORE_AT_ONCE
        for first in range(0, len(which), count):
            part = list(which[first : first + count])
            directions = np.zeros((count, self.n_unknowns))
            directions[np.arange(len(part)), part] = 1.0
            yield jnp.asarray(directions), len(part)

    def penalties(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, " penalty"]:
        """Distances of the constants from their priors' middle, in standard deviations; none of flat priors."""
        return np.asarray(self._penalties(jnp.asarray(unknowns)))[self._believed]

    def penalty_slopes(self, unknowns: Float[np.ndarray, " unknown"]) -> Float[np.ndarray, "penalty unknown"]:
        """Their derivatives in the unknowns."""
        return np.asarray(self._penalty_slopes(jnp.asarray(unknowns)))[self._believed]

    def excess(self, unknowns: Float[np.ndarray, " unknown"]) -> float:
        """How far the farthest state lies outside of what the fast model was trained on, above 1; covered up to 1."""
        return max(float(self._predict(courses, jnp.asarray(unknowns))[1]) for courses, _ in self._stacked)

    def model(self, unknowns: Float[np.ndarray, " unknown"]) -> Model:
        """The model with the constants put in; causes are not in it."""
        return self._model(unknowns)


def _linearised(function: Callable[[Array], Array], at: Array, directions: Array) -> tuple[Array, Array]:
    """Value, and derivative along each direction; what depends on none, such as gradients of pushes, computed once."""
    value, linear = jax.linearize(function, at)
    return value, map_in_batches(linear, directions, _DIRECTIONS_AT_ONCE).T
