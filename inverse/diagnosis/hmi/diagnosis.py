"""The diagnosis of curves of displacement, from the data to a verdict."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Int

from arfjax import Discretisation, Effort, Experiment, InputError
from inverse.datasets.hmi import HmiData
from inverse.diagnosis.cause import require_causes
from inverse.diagnosis.diagnosis import Diagnosis, conclude, failed
from inverse.diagnosis.examination import FullFit, visible_alternatives
from inverse.diagnosis.gain import Gain
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.causes import HMI_CAUSES
from inverse.diagnosis.hmi.courses import HmiRows, hmi_rows
from inverse.diagnosis.hmi.examination import Refits, examine_hmi
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.gain import held_out_gain_hmi
from inverse.diagnosis.hmi.noise_size import noise_size, size_beside_effect
from inverse.diagnosis.hmi.prepare import (
    LEARNT,
    PreparedHmi,
    free_constants,
    hmi_problem_of,
    prepare_hmi,
)
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.diagnosis.hmi.refit import SETTLED, again_from, fit_hmi, fit_in_full
from inverse.diagnosis.level import require_level
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.outlying import outlying, said_of
from inverse.diagnosis.where import Axis
from inverse.hmi_model import plan_sweeps, require_during
from inverse.inference.experiment import InferenceSettings, inference_settings
from inverse.precision import require_double_precision

_FIRST_SIZE = 0.02
"""Relative deviation of a reading that a fit starts from, where the data do not give it."""
_TRUSTED = 0.9
"""Part of a reading's weight below which it is said that the mesh took the rest."""
_FOLLOWED = 3
"""Causes whose intervals' ends are searched for, half a minute to three each: a true one is hardly ever beyond them."""
_AGREEMENT = 0.1
"""Of what fits from two starts make least, in units of one over the number of data, above which they differ."""
LEAST_SPARE = 4
"""Readings beyond the number of fitted constants below which nothing is said about the model."""


def diagnose_hmi(
    data: HmiData,
    described: Experiment,
    *,
    name: str = "experiment",
    causes: Sequence[HmiCause] = HMI_CAUSES,
    level: float = 0.05,
    seed: int = 0,
    replicates: int | None = None,
    gain: bool = True,
    asked: Sequence[str] = (),
    effort: Effort = LEARNT,
    discretisation: Discretisation | None = None,
    prepared: PreparedHmi | None = None,
    program: HmiProgram | None = None,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say what is wrong with the simulation of harmonic motion imaging, and what mending it is worth.

    Args:
        data: From `read_hmi`.
        described: The experiment.
        name: Of the experiment, for messages.
        causes: The library to look in.
        level: Probability of finding something wrong where nothing is.
        seed: Of starts, draws and replicates.
        replicates: Data sets of noise alone that error rates are calibrated on: if not said 1600, more at lower levels.
        gain: Whether to measure the held-out gain.
        asked: Names of causes that the data have to see: if they do not, that is said before the longest part.
        effort: How much goes into the fast simulation.
        discretisation: Of the full simulation that the fast one learns from; see `prepare_hmi` if not given.
        prepared: The fast simulation, where there is one of these sonications already.
        program: Compiled already, for other data measured in the same states.
        on_step: Told what is being done.

    Raises:
        InputError: if data and experiment do not go together, there are too few data or no causes, one that was asked
            for cannot be seen, or `level` or `replicates` is out of range.
        ValueError: if JAX runs in single precision.
    """
    replicates = require_level(level, replicates, few=True)
    require_causes(causes)
    require_double_precision("diagnoses")
    settings = require_diagnosable(data, described, name)
    if prepared is None:
        prepared = prepare_hmi(
            described, settings, data, seed=seed, effort=effort, discretisation=discretisation, on_step=on_step
        )
    problem = hmi_problem_of(prepared, data, described, settings, causes, program=program)
    return diagnose_curves(
        problem, causes=causes, level=level, seed=seed, replicates=replicates, gain=gain, asked=asked, on_step=on_step
    )


def diagnose_curves(
    problem: HmiDiagnosisProblem,
    *,
    corrected: bool = True,
    causes: Sequence[HmiCause] = HMI_CAUSES,
    level: float = 0.05,
    seed: int = 0,
    replicates: int | None = None,
    gain: bool = True,
    asked: Sequence[str] = (),
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """The same for data that have their simulation already.

    Args:
        problem: Data and simulation, `causes` among those that it holds.
        corrected: Whether the fast simulation is corrected to the full one at every fit; not for data that it made.
        causes: The library to look in.
        level: Probability of finding something wrong where nothing is.
        seed: Of starts, draws and replicates.
        replicates: Data sets of noise alone that error rates are calibrated on: if not said 1600, more at lower levels.
        gain: Whether to measure the held-out gain.
        asked: Names of causes that the data have to see.
        on_step: Told what is being done.

    Raises:
        InputError: if there are no causes, one that was asked for cannot be seen, or `level` or `replicates` is out of
            range.
    """
    replicates = require_level(level, replicates, few=True)
    require_causes(causes)
    on_step("fitting")
    null, size, audit = _fitted(problem, causes, corrected, seed, on_step)
    problem = null.problem
    if not null.converged:
        remark = f"the fit without causes: {null.status}."
        account = HmiAccount(problem, null, seed)
        return failed(account, problem, null.of_readings, [remark, *audit], level=level, seed=seed)
    on_step("testing all causes")
    rng = np.random.default_rng(seed)
    examined = examine_hmi(
        causes, null, rng, size=size, corrected=corrected, level=level, replicates=replicates, asked=asked
    )
    assert isinstance(examined.fit, Refits)
    # In the kind of noise that the tests go by, as refits with causes are.
    account = HmiAccount(examined.fit.null.problem, examined.fit.null, seed)

    def worth(extended: FullFit, noise: Noise) -> Gain | None:
        assert isinstance(extended, HmiFit)
        return held_out_gain_hmi(noise, size=size, null=account.null, extended=extended)

    found = conclude(
        examined, account, account.problem, rng, audit=audit, axes=_axes(problem), repeats=None,
        gain=worth if gain else None, level=level, seed=seed, replicates=replicates, followed=_FOLLOWED,
        on_step=on_step,
    )  # fmt: skip
    return dataclasses.replace(found, audit=(*found.audit, *examined.fit.remarks()))


def require_diagnosable(data: HmiData, described: Experiment, name: str = "experiment") -> InferenceSettings:
    """What the experiment says of inference, if the data can be diagnosed with it.

    Args:
        data: From `read_hmi`.
        described: The experiment.
        name: Of the experiment, for messages.

    Raises:
        InputError: if they cannot.
    """
    data, settings = data.without_copies(), inference_settings(described, name)
    rows, protocol = hmi_rows(data, settings.reference_temperature_c), described.stepwise()
    plan_sweeps(data, protocol, settings.reference_temperature_c)
    require_during(data, protocol.duration)
    _require_enough(data, rows, len(free_constants(described, settings).names))
    return settings


def _require_enough(data: HmiData, rows: HmiRows, constants: int) -> None:
    spare = len(rows) - len(rows.labels) - constants
    if spare < LEAST_SPARE:
        added = int(np.sum(rows.file_row < 0))
        counted = f" ({added} of them the references, 100 percent, that are in no row)" if added else ""
        raise InputError(
            f"{data.path}: {len(rows)} readings{counted} for {constants} constants and a factor of each of "
            f"{len(rows.labels)} sonications leave {spare} to judge the simulation by; at least {LEAST_SPARE} are "
            "needed: measure more, or free fewer constants in `[inference]`."
        )


def _fitted(
    problem: HmiDiagnosisProblem,
    causes: Sequence[HmiCause],
    corrected: bool,
    seed: int,
    on_step: Callable[[str], None],
) -> tuple[HmiFit, float, tuple[str, ...]]:
    """The null fit, by the full simulation where it came out; the noise; what the fit says against itself."""
    white = problem.noise_family()[0]
    size = 1.0 if problem.rows.deviation is not None else _FIRST_SIZE
    null = fit_hmi(problem, (), white, size=size)
    if problem.rows.deviation is None:
        size = noise_size(null)
        null = fit_hmi(problem, (), white, size=size, start=null.unknowns)
    on_step("fitting from another start")
    start = problem.program.null()
    spread = 0.5 * np.random.default_rng(seed).standard_normal(len(problem.program.start))
    start[problem.program.constants] += spread * problem.program.spreads
    other = fit_hmi(problem, (), white, size=size, start=start)
    chosen = other if other.converged and (other.misfit < null.misfit or not null.converged) else null
    remarks, null = _disagreement(null, other, chosen), chosen
    if corrected:
        on_step("full simulation where the fit is")
        null = fit_in_full(problem, (), white, size=size, start=null.unknowns)
        if problem.rows.deviation is None:
            size = noise_size(null)
        on_step("full simulation on a finer mesh")
        null = dataclasses.replace(null, problem=null.problem.trusted(null.unknowns, size))
        null = again_from(null, white, size)
        if problem.rows.deviation is None:
            # Readings that are trusted less have changed the unit: once more, with priors weighed in the new one.
            size = noise_size(null)
            null = again_from(null, white, size)
    if problem.rows.deviation is None and null.converged:
        null, size, said = _beside_effect(null, causes, size, corrected)
        remarks = (*remarks, *said)
    return null, size, (*remarks, *fit_remarks(null))


def _beside_effect(
    null: HmiFit, causes: Sequence[HmiCause], size: float, corrected: bool
) -> tuple[HmiFit, float, tuple[str, ...]]:
    """The fit with priors weighed against the noise beside an effect, if it has one; the noise; what is said of it."""
    names, family, spread = {cause.name for cause in causes}, null.problem.noise_family(), noise_size(null)
    found = [a for a in null.problem.alternatives(null.unknowns, null.directions, spread) if a.name in names]
    seen, _ = visible_alternatives(found, null.residuals, null.directions, spread, causes)
    smaller = size_beside_effect(null.residuals, null.directions, family, seen, size)
    if smaller == size:
        return null, size, ()
    problem = null.problem.trusted(null.unknowns, smaller) if corrected else null.problem
    fit = fit_in_full if corrected else fit_hmi
    again = fit(problem, (), family[0], size=smaller, start=null.unknowns)
    if again.converged:
        return again, smaller, ()
    unmoved = f"Priors weigh against all residuals, an effect included: beside it the fit failed ({again.status})."
    return null, size, (unmoved,)


def _disagreement(null: HmiFit, other: HmiFit, chosen: HmiFit) -> tuple[str, ...]:
    if abs(other.misfit - null.misfit) <= _AGREEMENT * null.misfit / len(null.problem.rows):
        return ()
    if chosen.misfit == min(null.misfit, other.misfit):
        return ("Fits from two starts do not agree: the better one is used.",)
    return ("Fits from two starts do not agree: the better one did not converge, and the other one is used.",)


def fit_remarks(null: HmiFit) -> tuple[str, ...]:
    """What a fit without causes says against itself."""
    problem = null.problem
    far = np.abs(problem.program.penalties(null.unknowns))
    remarks = [
        f"{name} comes out {distance:.1f} standard deviations from what was believed of it."
        for name, distance in zip(problem.program.names_of_beliefs, far, strict=True)
        if distance > 2.5
    ]
    if null.left > SETTLED:
        remarks.append(
            f"Where the fit came out, the full simulation is still {null.left:.1f} standard deviations of the noise "
            "(all readings together) from what was fitted: it did not come to rest."
        )
    names = problem.program.parameters.names
    if problem.trust is not None and np.min(problem.trust) < _TRUSTED:
        rows, least = problem.rows, int(np.argmin(problem.trust))
        remarks.append(
            f"On a finer mesh the simulation comes out otherwise, most of all at {rows.temperature[least]:.0f} degC in "
            f"sonication {rows.labels[rows.sonication[least]]}: {np.sum(problem.trust < _TRUSTED)} readings weigh less "
            f"for it, that one {problem.trust[least]:.2f} of what its noise alone would give it."
        )
    lengths = np.linalg.norm(null.directions[: len(problem.rows), : len(names)], axis=0)
    unseen = [name for name, one in zip(names, lengths, strict=True) if one < 1e-3 * np.max(lengths)]
    if unseen:
        remarks.append(f"These data hardly see {', '.join(unseen)}: what was believed of them stands.")
    return (*remarks, *_slips(null))


def _slips(null: HmiFit) -> tuple[str, ...]:
    """Readings that hold the misfit."""
    problem, rows = null.problem, null.problem.rows
    number = np.append(np.arange(len(rows)), np.full(len(null.residuals) - len(rows), -1))
    found, share = outlying(null.residuals, null.directions, number)
    places = [
        f"{rows.temperature[one.reading]:.3g} degC in sonication {rows.labels[rows.sonication[one.reading]]}, "
        f"{100.0 * np.expm1(float(one.amount[0]) / problem.weights[one.reading]):+.3g} % off what the others say"
        for one in found
    ]
    return said_of(places, share)


def _axes(problem: HmiDiagnosisProblem) -> tuple[Axis, ...]:
    rows = problem.rows
    everywhere = np.zeros(len(rows), dtype=int)
    axes = (
        Axis("time", rows.sonication, rows.time),
        Axis("temperature in all sonications", everywhere, rows.temperature),
        Axis("sonications at one temperature", _once_a_sonication(rows), rows.sonication.astype(float)),
    )
    return axes if rows.dose is None else (*axes, Axis("thermal dose in all sonications", everywhere, rows.dose))


def _once_a_sonication(rows: HmiRows) -> Int[np.ndarray, " row"]:
    """Readings at about one temperature, numbered; each sonication's first there, then each one's second."""
    rounded, seen, place = np.round(rows.temperature), dict[tuple[int, float], int](), []
    for key in zip(rows.sonication.tolist(), rounded.tolist(), strict=True):
        seen[key] = seen.get(key, -1) + 1
        place.append(seen[key])
    return np.unique(np.stack([rounded, place]), axis=1, return_inverse=True)[1].reshape(-1)
