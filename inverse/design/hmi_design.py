"""The next sonication: which would tell the causes apart that curves of displacement leave alive.

Every proposal is simulated with the fitted model, without the causes and with each as strong as the data have it: their
effects bend within such strengths (see `HmiDiagnosisProblem.alternatives`), so that derivatives would rate others.
Derivatives in the constants are central differences, as exact ones take several times as long to compile, once for
nearly every proposal (nine that were looked at differed by up to 4e-8 of their length). Readings have the noise of
those that there are, and a factor of their own. The fast simulation has learnt from pushes as they were: others,
modulated or of twice or half the length, are within 3 percent of the full one (0.6 percent for the usual; the paper's
case, seven temperatures from 37 to 78 degC).
"""

import dataclasses
import itertools
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from arfjax import Effort, Experiment
from inverse.cores import side_by_side
from inverse.datasets.hmi import HmiData
from inverse.design.design import Check, Design, Rated, alive, checked, reasons
from inverse.design.hmi_proposals import HmiProposal, hmi_proposals
from inverse.design.separation import Separation, separation
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.choice import find_causes
from inverse.diagnosis.diagnosis import Diagnosis
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.causes import HMI_CAUSES
from inverse.diagnosis.hmi.chain import Course
from inverse.diagnosis.hmi.courses import HmiRows, hmi_rows, plan_courses
from inverse.diagnosis.hmi.diagnosis import diagnose_curves, diagnose_hmi
from inverse.diagnosis.hmi.prepare import LEARNT, PreparedHmi, prepare_hmi
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.inference.experiment import inference_settings

NOT_RATED = (
    "No sonication can be rated: the constants that fit these curves lie outside of what the fast simulation was made "
    "for (`arfjax diagnose` says which); widen their priors in `[inference]`."
)
_COVERED = 1.0
_NEXT = "next"
_STEP = 1e-3
"""Of a difference, in standard deviations of the prior."""


@dataclasses.dataclass(frozen=True)
class _Fitted:
    """The diagnosed data, and what is to be told apart.

    Attributes:
        unknowns: Of the fit without causes, the causes' second parameters as the data have them.
        lean: The program with nothing but the causes in question, which compiles faster, and the same unknowns for it.
        effects: Of causes and constants on what was measured.
    """

    problem: HmiDiagnosisProblem
    prepared: PreparedHmi
    reference: float
    unknowns: Float[np.ndarray, " unknown"]
    extensions: Sequence[Extension[HmiCause]]
    strengths: Float[np.ndarray, " cause"]
    size: float
    lean: tuple[HmiProgram, Float[np.ndarray, " lean_unknown"]]
    effects: Float[np.ndarray, "row p"]

    @classmethod
    def about(
        cls,
        problem: HmiDiagnosisProblem,
        prepared: PreparedHmi,
        reference: float,
        unknowns: Float[np.ndarray, " unknown"],
        extensions: Sequence[Extension[HmiCause]],
        strengths: Float[np.ndarray, " cause"],
        size: float,
    ) -> "_Fitted":
        """About a fit without causes, whose unknowns have any second parameters."""
        program, shaped, count = problem.program, unknowns.copy(), len(problem.program.causes)
        places = np.array([program.place(extension.cause.name) for extension in extensions])
        shaped[count + places] = [float(extension.shape) for extension in extensions]
        kept = np.concatenate([places, count + places, program.constants])
        lean = program.with_causes([extension.cause for extension in extensions]), shaped[kept]
        effects = _effects(program, shaped, extensions, strengths)
        return cls(problem, prepared, reference, shaped, extensions, strengths, size, lean, effects)


def design_hmi(
    data: HmiData,
    described: Experiment,
    *,
    name: str = "experiment",
    found: Diagnosis | None = None,
    prepared: PreparedHmi | None = None,
    causes: Sequence[str] = (),
    library: Sequence[HmiCause] = HMI_CAUSES,
    check: bool = True,
    effort: Effort = LEARNT,
    seed: int = 0,
    on_step: Callable[[str], None] = lambda _: None,
) -> Design:
    """Rate sonications that could be made next by how well they would tell causes apart.

    Args:
        data: What was measured.
        described: The experiment.
        name: Of the experiment, for messages.
        found: The diagnosis of the data, made with `library`; made here if not given.
        prepared: The fast simulation behind it; made here if not given.
        causes: To be told apart; those that the diagnosis leaves possible, or the two likeliest, without.
        library: Causes.
        check: Whether to simulate the best proposal with each cause and to diagnose it again.
        effort: How much goes into the fast simulation, where it is made here.
        seed: Of simulations.
        on_step: Told what is being done, by one thread at a time, but of ratings not by that which calls.

    Raises:
        InputError: if there are no two causes to tell apart, or the fit itself failed.
    """
    wanted = [cause.name for cause in find_causes(causes, library)]
    settings = inference_settings(described, name)
    if prepared is None:
        prepared = prepare_hmi(described, settings, data, seed=seed, effort=effort, on_step=on_step)
    if found is None:
        found = diagnose_hmi(
            data, described, name=name, causes=library, seed=seed, gain=False, asked=wanted, prepared=prepared,
            on_step=on_step,
        )  # fmt: skip
    fitted = _fitted(found, prepared, settings.reference_temperature_c, causes, library)
    now = _separation(fitted, None, None)
    rows = fitted.problem.rows
    readings = int(np.max(np.bincount(rows.sonication)))
    hottest = float(np.max(rows.temperature))

    proposals = hmi_proposals(described.stepwise(), reference=fitted.reference, hottest=hottest, readings=readings)
    begun, one_at_a_time = itertools.count(1), threading.Lock()

    def rate(proposal: HmiProposal) -> Separation | None:
        with one_at_a_time:
            on_step(f"rating: {proposal.words}, {next(begun)} of {len(proposals)}")
        return _rating(fitted, proposal)

    ratings = list(zip(proposals, side_by_side(rate, proposals), strict=True))
    rated = [(proposal, separated) for proposal, separated in ratings if separated is not None]
    notes = [
        f"Not rated, because the fast simulation does not reach so far: {proposal.words}."
        for proposal, separated in ratings
        if separated is None
    ]
    if not rated:
        notes = [NOT_RATED]
    rated.sort(key=lambda one: -one[1].worst)
    checks = _checks(fitted, rated[0][0], library, seed, on_step) if check and rated else ()
    names = {e.cause.name: float(s) for e, s in zip(fitted.extensions, fitted.strengths, strict=True)}
    notes = (*reasons(found, causes, tuple(names)), *notes)
    return Design(found.verdict, names, now, tuple(Rated(*one) for one in rated), checks, (fitted.size,), seed, notes)


def _fitted(
    found: Diagnosis,
    prepared: PreparedHmi,
    reference: float,
    causes: Sequence[str],
    library: Sequence[HmiCause],
) -> _Fitted:
    extensions, strengths = alive(found, causes, library)
    assert isinstance(found.account, HmiAccount) and found.noise is not None
    problem = found.account.problem
    # Relative, as deviations that a file states say nothing of readings that are still to come.
    size = found.noise.size * float(np.median(1.0 / problem.weights))
    return _Fitted.about(problem, prepared, reference, found.account.null.unknowns, extensions, strengths, size)


def _rating(fitted: _Fitted, proposal: HmiProposal) -> Separation | None:
    """What a proposal would tell; None where the fast simulation does not reach so far."""
    courses, more = _planned(fitted, proposal)
    program, unknowns = fitted.lean
    if program.on(courses).excess(unknowns) > _COVERED:
        return None
    return _separation(fitted, courses, more)


def _planned(fitted: _Fitted, proposal: HmiProposal) -> tuple[list[Course], HmiRows]:
    """The proposal's sonication as the diagnosis plans those that were made."""
    count = len(proposal)
    blank = HmiData(
        Path(proposal.name), (_NEXT,) * count, proposal.temperature, None, np.full(count, 100.0), True, None, ()
    )
    rows = hmi_rows(blank, fitted.reference)
    settings = fitted.prepared.fast.curve.settings
    courses, rows = plan_courses(blank, rows, fitted.prepared.model, proposal.protocol, settings, fitted.reference)
    courses = [dataclasses.replace(course, immune=proposal.immune) for course in courses]
    return [dataclasses.replace(course, motion=_motion(fitted, course)) for course in courses], rows


def _motion(fitted: _Fitted, course: Course) -> float:
    """Displacement at the coldest reading over that with a push as in the sonications that were made, without causes.

    Strengths of what tracking adds are told in displacements of those.
    """
    program, unknowns = fitted.lean
    still = unknowns.copy()
    still[: len(program.causes)] = 0.0
    made = program.courses[0].protocol
    usual = dataclasses.replace(course.protocol, push_duration=made.push_duration, modulation=made.modulation)
    if usual == course.protocol:
        return 1.0
    before, now = (
        float(program.on([dataclasses.replace(course, protocol=one)]).coldest_displacement(still)[0])
        for one in (usual, course.protocol)
    )
    return now / before


def _separation(fitted: _Fitted, courses: Sequence[Course] | None, more: HmiRows | None) -> Separation:
    """Of the causes by what was measured, and by a proposal's courses beside it; noise of one relative size."""
    problem = fitted.problem
    parts = [fitted.effects]
    factors = problem.factors
    if courses is not None and more is not None:
        program, unknowns = fitted.lean
        parts.append(_effects(program.on(courses), unknowns, fitted.extensions, fitted.strengths))
        factors = np.block([
            [factors, np.zeros((len(factors), 1))],
            [np.zeros((len(more), factors.shape[1])), np.ones((len(more), 1))],
        ])  # fmt: skip
    effects, count = np.concatenate(parts), len(fitted.extensions)
    names = [extension.cause.name for extension in fitted.extensions]
    known = np.concatenate([effects[:, count:], factors], axis=1)
    believed = fitted.size * problem.program.penalty_slopes(fitted.unknowns)[:, problem.program.constants]
    known = np.append(known, np.pad(believed, [(0, 0), (0, factors.shape[1])]), axis=0)
    moved = np.pad(effects[:, :count], [(0, len(believed)), (0, 0)])
    signs = [extension.cause.sign for extension in fitted.extensions]
    return separation(names, moved, fitted.strengths, known, fitted.size, signs)


def _effects(
    program: HmiProgram,
    unknowns: Float[np.ndarray, " unknown"],
    extensions: Sequence[Extension[HmiCause]],
    strengths: Float[np.ndarray, " cause"],
) -> Float[np.ndarray, "row p"]:
    """Effects of the causes over their strengths, in their units, then derivatives in the constants."""
    plain, columns = program.predict(unknowns), []
    for extension, strength in zip(extensions, strengths, strict=True):
        cause = extension.cause
        effect = program.secant(unknowns, program.place(cause.name), float(strength) / cause.plausible, plain)
        columns.append(effect / cause.plausible)
    return np.column_stack([*columns, *_slopes(program, unknowns)])


def _slopes(program: HmiProgram, unknowns: Float[np.ndarray, " unknown"]) -> list[Float[np.ndarray, " row"]]:
    """Derivatives in the constants."""
    found = []
    for place, spread in zip(program.constants, program.spreads, strict=True):
        moved = np.zeros(len(unknowns))
        moved[place] = _STEP * spread
        found.append((program.predict(unknowns + moved) - program.predict(unknowns - moved)) / (2.0 * moved[place]))
    return found


def _checks(
    fitted: _Fitted, proposal: HmiProposal, library: Sequence[HmiCause], seed: int, on_step: Callable[[str], None]
) -> tuple[Check, ...]:
    """What was measured and the proposal, both simulated with each cause in turn, and diagnosed again."""
    together, checks = _joined(fitted, proposal), []
    for number, (extension, strength) in enumerate(zip(fitted.extensions, fitted.strengths, strict=True)):
        hidden = extension.cause.name
        on_step(f"simulating {proposal.name} with {hidden}")
        unknowns = fitted.unknowns.copy()
        unknowns[together.program.place(hidden)] = strength / extension.cause.plausible
        rng = np.random.default_rng([seed, number])
        read = together.program.predict(unknowns) + fitted.size * rng.standard_normal(len(together.rows))
        simulated = dataclasses.replace(together, rows=dataclasses.replace(together.rows, log_displacement=read))
        again = diagnose_curves(simulated, corrected=False, causes=library, seed=seed, gain=False)
        checks.append(checked(hidden, again))
    return tuple(checks)


def _joined(fitted: _Fitted, proposal: HmiProposal) -> HmiDiagnosisProblem:
    """Data and proposal as one problem, without deviations."""
    problem, rows = fitted.problem, fitted.problem.rows
    courses, more = _planned(fitted, proposal)
    moved = [dataclasses.replace(c, rows=np.asarray(c.rows) + len(rows)) for c in courses]
    joined = HmiRows(
        log_displacement=np.append(rows.log_displacement, more.log_displacement),
        sonication=np.append(rows.sonication, more.sonication + len(rows.labels)),
        labels=(*rows.labels, *more.labels),
        temperature=np.append(rows.temperature, more.temperature),
        time=np.append(rows.time, more.time),
        is_reference=np.append(rows.is_reference, more.is_reference),
        deviation=None,
        file_row=np.append(rows.file_row, np.full(len(more), -1)),
    )
    program = problem.program.on([*problem.program.courses, *moved])
    return HmiDiagnosisProblem(joined, program, problem.notes)
