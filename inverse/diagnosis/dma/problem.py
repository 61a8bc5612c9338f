"""A dynamic mechanical analysis as a diagnosis sees it: residuals of the fit, and their derivatives in everything."""

import dataclasses
import itertools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from arfjax import InputError
from inverse.datasets.copies import said_of_copies
from inverse.datasets.dma import DmaData, Sweep, group_sweeps
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.cause import DmaConditions, predicted_modulus
from inverse.diagnosis.noise import Ordering, series
from inverse.diagnosis.screening import Alternative
from inverse.dma_fit import CONVENTIONAL, SweepFit, ZenerModel, fit_sweeps
from inverse.dma_residuals import LogModulus
from inverse.parameters import Parameter

_RESIDUAL = LogModulus()
_SHORTEST_VISIT = 3
"""Rows at one temperature in a row, below which, in half of them, temperatures were changed from row to row."""
_COLDEST_DRYING = -100.0
"""Temperature [degC] below which vapour pressure is taken for what it is there, a hundred-thousandth of that at 0."""
LEAST_SPARE = 4
"""Data beyond the number of fitted constants below which nothing is said about the model."""


@dataclasses.dataclass(frozen=True)
class DmaProblem:
    """One data set with the model fitted to it.

    Attributes:
        sweeps: With the rows of each by ascending frequency.
        fits: Of the model, one a sweep.
        model: What was fitted.
        conditions: Of every row.
        rows: Number of rows.
        has_phase: Whether the phase was measured.
        weights: One over the standard deviation of each coordinate, where the data give it, and 1 elsewhere; over what
            `Weighing` says where that has been asked.
        stated_deviations: Whether the data give them.
        notes: What was assumed, for the report.
        seed: Of the starts of every fit.
        whole_drying: Pressure of saturated vapour, integrated over time, that exposures are a part of [Pa s].
    """

    sweeps: tuple[Sweep, ...]
    fits: tuple[SweepFit, ...]
    model: ZenerModel
    conditions: DmaConditions
    has_phase: bool
    weights: Float[np.ndarray, "row coordinate"]
    stated_deviations: bool
    notes: tuple[str, ...]
    seed: int
    whole_drying: float

    @property
    def rows(self) -> int:
        """Number of measured rows."""
        return len(self.conditions.angular_frequency)

    @property
    def constants(self) -> Float[np.ndarray, "sweep 4"]:
        """Fitted constants of every sweep; the order is 1 for the conventional solid."""
        rows = [np.append(fit.values, 1.0)[:4] for fit in self.fits]
        return np.stack(rows)

    @property
    def parameters(self) -> tuple[tuple[Parameter, ...], ...]:
        """What the fit of every sweep moves."""
        return tuple(self.model.parameters(sweep.data) for sweep in self.sweeps)

    @property
    def moved(self) -> Float[np.ndarray, "sweep n"]:
        """Values of what the fit moves: the branch's modulus in place of the unrelaxed one."""
        return _moved(self.fits)

    def moved_by(self, used: Bool[np.ndarray, " row"]) -> Float[np.ndarray, "sweep n"]:
        """The same of a fit to a part of the rows, from starts of its own."""
        sweep, parts = np.asarray(self.conditions.sweep), []
        for index, whole in enumerate(self.sweeps):
            data = whole.data.select(np.flatnonzero(used[sweep == index]))
            parts.append(dataclasses.replace(whole, data=data))
        longest = max(len(whole.data) for whole in self.sweeps)
        fit = fit_sweeps(parts, models=(self.model,), residuals=(_RESIDUAL,), seed=self.seed, padded_to=longest)
        return _moved(fit.fits)

    @property
    def measured(self) -> Float[np.ndarray, "row coordinate"]:
        """Logarithm of the measured magnitude, and phase where it was measured."""
        return np.concatenate([_coordinates_of(sweep.data, self.has_phase) for sweep in self.sweeps])

    def residuals(self) -> Float[np.ndarray, " n"]:
        """Measured less predicted, weighted."""
        predicted = np.asarray(_predicted(jnp.asarray(self.constants), self.conditions, self.has_phase))
        return (self.weights * (self.measured - predicted)).ravel()

    def fitted_directions(self) -> Float[np.ndarray, "n p"]:
        """Derivative of the weighted prediction in the constants of every sweep."""
        count = len(self.model.constants())
        jacobian = np.asarray(in_constants(jnp.asarray(self.constants), self.conditions, self.has_phase))
        columns = jacobian[..., :count].reshape(*self.weights.shape, -1)
        return (self.weights[:, :, None] * columns).reshape(self.weights.size, -1)

    def directions(
        self, extensions: Sequence[Extension], constants: Float[np.ndarray, "sweep 4"] | None = None
    ) -> list[Alternative]:
        """Derivative of the weighted prediction in the strength of every extension, at strength 0.

        Args:
            extensions: Each cause in each of its shapes, for example.
            constants: Where; the fitted ones without.
        """
        constants = self.constants if constants is None else constants
        found = []
        columns = in_strengths(jnp.asarray(constants), self.conditions, tuple(extensions), self.has_phase)
        for extension, column in zip(extensions, np.asarray(columns), strict=True):
            direction = (self.weights * column).reshape(-1, 1)
            shape = float(extension.shape) if extension.has_shape else None
            found.append(Alternative(extension.cause.name, direction, extension.cause.sign, shape))
        return found

    def orderings(self) -> tuple[Ordering, ...]:
        """Neighbours along frequency, and along time where those are others: noise knows no forward and backward."""
        coordinates = self.weights.shape[1]
        keys = [(int(one), c) for one in np.asarray(self.conditions.visit) for c in range(coordinates)]
        along = {
            "frequency": np.asarray(self.conditions.angular_frequency),
            "time": np.asarray(self.conditions.time),
        }
        found = [series(name, keys, np.repeat(values, coordinates)) for name, values in along.items()]
        return (found[0],) if found[0].neighbours == found[1].neighbours else tuple(found)

    def frequencies(self) -> Float[np.ndarray, " n"]:
        """Frequency of every residual [Hz]."""
        return np.repeat(np.asarray(self.conditions.angular_frequency) / (2.0 * np.pi), self.weights.shape[1])


def dma_problem(
    data: DmaData, model: ZenerModel, *, seed: int = 0, n_starts: int = 16, whole_drying: float | None = None
) -> DmaProblem:
    """Fit the model to every sweep of a data set and get it ready for a diagnosis.

    Args:
        data: From `read_dma`, in the order of the file.
        model: The null model.
        seed: Of the starts of the fit.
        n_starts: Starts of each fit.
        whole_drying: That of another problem, where strengths are to mean what they do there; without, that of the
            sample that dries most.

    Returns:
        The problem on the sweeps that could be fitted.

    Raises:
        InputError: if there are too few data; see `usable_sweeps`.
    """
    kept = data.without_copies()
    copies = said_of_copies(kept.n_copies - data.n_copies)
    data, notes = _with_time(kept)
    notes = (*copies, *notes)
    needed, sweeps = len(model.constants()), usable_sweeps(data, model)
    fit = fit_sweeps(sweeps, models=(model,), residuals=(_RESIDUAL,), seed=seed, n_starts=n_starts)
    weights, stated = _weights(sweeps)
    if data.has_phase and not stated and data.modulus_magnitude_sd is not None:
        notes = (*notes, "The magnitude's standard deviation is not used beside both moduli: theirs would be.")
    drying = _drying(sweeps)
    whole = max(float(np.max(np.concatenate(drying))), 1e-300) if whole_drying is None else whole_drying
    left_out = len(group_sweeps(data)) - len(sweeps)
    if left_out:
        notes = (*notes, f"{left_out} sweeps with too few frequencies for {needed} constants were left out.")
    return DmaProblem(
        sweeps=sweeps,
        fits=fit.fits,
        model=model,
        conditions=_conditions(sweeps, np.concatenate(drying) / whole),
        has_phase=data.has_phase,
        weights=weights,
        stated_deviations=stated,
        notes=notes,
        seed=seed,
        whole_drying=whole,
    )


def usable_sweeps(data: DmaData, model: ZenerModel) -> tuple[Sweep, ...]:
    """Sweeps that the model can be fitted to.

    Raises:
        InputError: if none has more frequencies than the model has constants, or all together hardly more numbers.
    """
    needed = len(model.constants())
    sweeps = tuple(s for s in group_sweeps(data) if s.data.distinct_frequencies > needed)
    if not sweeps:
        raise InputError(
            f"no sweep has more than {needed} frequencies, which is what the constants of the {model.name} model take; "
            f"measure more frequencies at one temperature{_of_fewer(data, model)}."
        )
    numbers = sum(len(sweep.data) for sweep in sweeps) * (2 if data.has_phase else 1)
    spare = numbers - needed * len(sweeps)
    if spare < LEAST_SPARE:
        raise InputError(
            f"{numbers} numbers for {needed * len(sweeps)} constants leave {spare} to judge the model by; at "
            f"least {LEAST_SPARE} are needed: measure more frequencies, or the phase."
        )
    return sweeps


def _of_fewer(data: DmaData, model: ZenerModel) -> str:
    """The model that would do with these, if there is one."""
    enough = max(sweep.data.distinct_frequencies for sweep in group_sweeps(data)) > len(CONVENTIONAL.constants())
    return ", or examine the conventional solid (model `zener`)" if model.fractional and enough else ""


def _moved(fits: Sequence[SweepFit]) -> Float[np.ndarray, "sweep n"]:
    values = np.stack([fit.values for fit in fits])
    values[:, 1] -= values[:, 0]
    return values


def _with_time(data: DmaData) -> tuple[DmaData, tuple[str, ...]]:
    """Rows counted through each sample where the file gives no time."""
    if data.time_s is not None:
        return data, ()
    labels = data.sample or ("",) * len(data)
    time, seen = np.zeros(len(data)), dict.fromkeys(labels, 0)
    for row, label in enumerate(labels):
        time[row] = seen[label]
        seen[label] += 1
    note = "The file gives no time: rows are taken for equally long and in the order in which they were measured."
    return dataclasses.replace(data, time_s=time), (note,)


def _times(data: DmaData) -> Float[np.ndarray, " row"]:
    return np.asarray(data.time_s, dtype=float)


def _conditions(sweeps: Sequence[Sweep], exposure: Float[np.ndarray, " row"]) -> DmaConditions:
    data = [sweep.data for sweep in sweeps]
    sizes = [len(one) for one in data]
    begun: dict[str, float] = {}
    for one in sweeps:
        begun[one.sample] = min(begun.get(one.sample, np.inf), float(_times(one.data).min()))
    time = np.concatenate([_times(one.data) - begun[one.sample] for one in sweeps])
    sweep = np.repeat(np.arange(len(sweeps)), sizes)
    visit, before = _visits(sweeps, sweep, time)
    passed = np.zeros(len(time))
    for one in np.unique(visit):
        rows = visit == one
        passed[rows] = (time[rows] - time[rows].min()) / max(np.ptp(time[rows]), 1e-300)
    magnitude = [one.modulus_magnitude for one in data]
    return DmaConditions(
        angular_frequency=jnp.asarray(2.0 * np.pi * np.concatenate([one.frequency_hz for one in data])),
        temperature=jnp.asarray(np.concatenate([one.temperature_c for one in data])),
        time=jnp.asarray(time),
        time_in_sweep=jnp.asarray(passed),
        exposure=jnp.asarray(exposure),
        level=jnp.asarray(np.repeat([np.exp(np.mean(np.log(m))) for m in magnitude], sizes)),
        softest=jnp.asarray(min(m.min() for m in magnitude)),
        stiffest=jnp.asarray(max(m.max() for m in magnitude)),
        sweep=jnp.asarray(sweep),
        visit=jnp.asarray(visit),
        sweep_before=jnp.asarray(before),
    )


def _visits(
    sweeps: Sequence[Sweep], sweep: Int[np.ndarray, " row"], time: Float[np.ndarray, " row"]
) -> tuple[Int[np.ndarray, " row"], Int[np.ndarray, " row"]]:
    """Visit of each row, in the order in which each sample was measured, and the sweep of the visit before.

    Rows that change temperature all the time are in no order of visits: there every sweep is one. Few readings between
    two sweeps, to see whether a temperature measures as it did, are visits.
    """
    visit, before = np.zeros(len(sweep), dtype=int), sweep.copy()
    labels = np.array([one.sample for one in sweeps])[sweep]
    count = 0
    for sample in dict.fromkeys(labels.tolist()):
        rows = np.flatnonzero(labels == sample)
        starts = np.array([time[sweep == one].min() for one in range(len(sweeps))])
        rows = rows[np.argsort(time[rows], kind="stable")]
        parts = np.split(rows, np.flatnonzero(np.diff(sweep[rows])) + 1)
        if np.median([len(part) for part in parts]) < _SHORTEST_VISIT:
            rows = rows[np.lexsort((time[rows], sweep[rows], starts[sweep[rows]]))]
            parts = np.split(rows, np.flatnonzero(np.diff(sweep[rows])) + 1)
        for earlier, part in zip([parts[0], *parts], parts, strict=False):
            visit[part], before[part] = count, sweep[earlier[0]]
            count += 1
    return visit, before


def _drying(sweeps: Sequence[Sweep]) -> list[Float[np.ndarray, " row"]]:
    """Pressure of saturated vapour, integrated over time from the first reading of each sample [Pa s]."""
    found = [np.zeros(len(sweep.data)) for sweep in sweeps]
    for sample in dict.fromkeys(sweep.sample for sweep in sweeps):
        members = [index for index, sweep in enumerate(sweeps) if sweep.sample == sample]
        time = np.concatenate([_times(sweeps[i].data) for i in members])
        pressure = np.concatenate([_vapour_pressure(sweeps[i].data.temperature_c) for i in members])
        order = np.argsort(time, kind="stable")
        steps = np.diff(time[order]) * 0.5 * (pressure[order][1:] + pressure[order][:-1])
        lost = np.empty(len(time))
        lost[order] = np.concatenate([[0.0], np.cumsum(steps)])
        ends = np.cumsum([len(sweeps[i].data) for i in members])
        for index, part in zip(members, np.split(lost, ends[:-1]), strict=True):
            found[index] = part
    return found


def _vapour_pressure(temperature: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    """Of water [Pa], by the Magnus formula; far below its range, where nothing dries, at the coldest it is taken at."""
    felt = np.maximum(temperature, _COLDEST_DRYING)
    return 610.94 * np.exp(17.625 * felt / (243.04 + felt))


def _coordinates_of(data: DmaData, has_phase: bool) -> Float[np.ndarray, "row coordinate"]:
    if not has_phase:
        return np.log(data.modulus_magnitude)[:, None]
    phase = np.arctan2(np.asarray(data.loss_modulus), np.asarray(data.storage_modulus))
    return np.stack([np.log(data.modulus_magnitude), phase], axis=-1)


def _weights(sweeps: Sequence[Sweep]) -> tuple[Float[np.ndarray, "row coordinate"], bool]:
    coordinates = 2 if sweeps[0].data.has_phase else 1
    deviations = [_RESIDUAL.standard_deviations(sweep.data) for sweep in sweeps]
    known = [one for one in deviations if one is not None]
    if len(known) < len(sweeps):
        return np.ones((sum(len(sweep.data) for sweep in sweeps), coordinates)), False
    return 1.0 / np.concatenate(known)[:, :coordinates], True


def predict_coordinates(
    constants: Float[Array, "sweep 4"],
    conditions: DmaConditions,
    extensions: tuple[Extension, ...],
    strengths: Float[Array, " extension"],
    has_phase: bool,
) -> Float[Array, "row coordinate"]:
    """Logarithm of the magnitude, and phase where it was measured, of every row."""
    return coordinates_of_modulus(predicted_modulus(constants, conditions, extensions, strengths), has_phase)


def coordinates_of_modulus(modulus: Complex[Array, " row"], has_phase: bool) -> Float[Array, "row coordinate"]:
    """Logarithm of the magnitude, and phase where it was measured."""
    magnitude = 0.5 * jnp.log(modulus.real**2 + modulus.imag**2)
    if not has_phase:
        return magnitude[:, None]
    return jnp.stack([magnitude, jnp.arctan2(modulus.imag, modulus.real)], axis=-1)


@eqx.filter_jit
def _predicted(constants, conditions, has_phase):
    return predict_coordinates(constants, conditions, (), jnp.zeros(0), has_phase)


@eqx.filter_jit
def in_constants(constants, conditions, has_phase):
    """Derivative of logarithm of the magnitude and phase in the constants: row, coordinate, sweep, constant.

    Args:
        constants: As reported, a row for each sweep.
        conditions: Of every row.
        has_phase: Whether phases were measured, or magnitudes alone.
    """
    return jax.jacfwd(lambda c: predict_coordinates(c, conditions, (), jnp.zeros(0), has_phase))(constants)


@eqx.filter_jit
def in_strengths(constants, conditions, extensions, has_phase):
    """The same in the strength of each extension, at strength 0: extension, row, coordinate."""

    def slope(cause, shape):
        def response(strength):
            return predict_coordinates(constants, conditions, (Extension(cause, shape),), strength[None], has_phase)

        return jax.jvp(response, (jnp.zeros(()),), (jnp.ones(()),))[1]

    # Shapes of one cause together: one by one, their program would take three times as long to compile.
    found = []
    for _, alike in itertools.groupby(extensions, key=lambda extension: extension.cause.name):
        first, *others = alike
        shapes = jnp.array([one.shape for one in (first, *others)])
        found.append(jax.vmap(lambda shape, cause=first.cause: slope(cause, shape))(shapes))
    return jnp.concatenate(found)
