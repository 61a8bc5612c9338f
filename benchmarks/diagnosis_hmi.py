"""How often the diagnosis of displacement is right, on curves with hidden effects that a full simulation made.

python -m benchmarks.diagnosis_hmi --out benchmarks/records/diagnosis_hmi.jsonl --sets 1 --docs docs

It goes on where the record stops, if that is of the same code. `--minutes 0` writes the page of what is there.

The data come from `tests/blind/hmi_generator`, which simulates on another mesh and shares no code with `inverse`, on
seeds that chose no threshold (`--development` takes the others). Every data set is one line of `--out`; what is there
is summed up beside it. Sets are taken from all conditions in turn. Every process of `--workers` prepares the fast
simulation once.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dataclasses
import functools
import json
import platform
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import arfjax as ax
from benchmarks.diagnosis_docs import write_docs
from benchmarks.diagnosis_limits import Design, limits, projected_length
from benchmarks.diagnosis_record import arguments, code_of, recorded, stamp
from benchmarks.diagnosis_studies import HMI_STUDY
from benchmarks.diagnosis_summary import NO_DATA, summarise
from inverse.datasets.hmi import HmiData, read_hmi
from inverse.datasets.shipped import shipped
from inverse.diagnosis import HMI_CAUSES, Diagnosis, diagnose_hmi
from inverse.diagnosis.examination import MOST_IMPLAUSIBLE
from inverse.diagnosis.hmi.account import HmiAccount
from inverse.diagnosis.hmi.fitting import HmiFit
from inverse.diagnosis.hmi.free_forms import hmi_local_forms, of_all_data
from inverse.diagnosis.hmi.noise_size import noise_size
from inverse.diagnosis.hmi.prepare import PreparedHmi, hmi_problem_of, prepare_hmi
from inverse.diagnosis.hmi.problem import Effect, HmiDiagnosisProblem
from inverse.diagnosis.hmi.program import HmiProgram
from inverse.inference.experiment import inference_settings
from tests.blind import hmi_generator as blind
from tests.blind.no_such_effect import NoSuchEffect

NOISES = ("white", "tails", "correlated-0.3", "correlated-0.6", "loud")
STRENGTHS = (4.5, 6.0)
TRUE_SHAPES = {"cavitation": 67.8, "pre-ablation-softening": 48.25, "thermocouple-viscous-heating": 3.0}
"""What the generator has where a cause has a second parameter: onsets midway between two that are looked for, and a
time of the wire that is one of those looked for."""
FIRST_TEST_SEED = 2_700_000
"""Noise, signs and hidden causes of these nobody had looked at when the diagnosis was written; records of other seeds
are in the history. All test seeds draw from the same six tissues."""
SOURCES = (
    "arfjax/protocols/fast_*.py",
    "inverse/fast_hmi.py",
    "inverse/diagnosis/*.py",
    "inverse/diagnosis/hmi/*.py",
    "inverse/diagnosis/hmi/causes/*.py",
    "tests/blind/hmi_*.py",
)
"""Code that a record depends on; what it is built upon changes seldom, and says so in CHANGELOG.md."""


@dataclasses.dataclass(frozen=True)
class Condition:
    """What is hidden, and how; as in `benchmarks.diagnosis`, and the relative size of the noise."""

    part: str
    name: str
    d_prime: float
    noise: str = "white"
    size: float = blind.NOISE


def conditions() -> list[Condition]:
    """All of them; the place in this list fixes the seeds."""
    weak, strong = ([Condition("known", name, d) for name in blind.EFFECTS] for d in STRENGTHS)
    null = [Condition("null", "none", 0.0, noise) for noise in NOISES]
    unknown = [Condition("unknown", name, 9.0) for name in blind.UNKNOWN]
    removed = [Condition("removed", name, 9.0) for name in blind.EFFECTS]
    return [*weak, *null, *unknown, *strong, *removed]


@dataclasses.dataclass(frozen=True)
class Bench:
    """What all data sets share: the experiment, its fast simulation, the generator, and its ruler of strengths."""

    described: ax.Experiment
    prepared: PreparedHmi
    program: HmiProgram
    fine: blind.Simulator
    ruler: blind.Simulator


@functools.cache
def prepared_bench() -> Bench:
    """Prepare once a process; minutes."""
    with tempfile.TemporaryDirectory() as folder:
        return _prepare(Path(folder))


def _prepare(folder: Path) -> Bench:
    described = ax.read_experiment(shipped("suomi2016_experiment"))
    fine = blind.Simulator(described)
    blind.write(folder / "any.csv", folder / "any.json", fine=fine, ruler=fine, seed=1)
    data, settings = read_hmi(folder / "any.csv"), inference_settings(described, "suomi2016_experiment")
    prepared = prepare_hmi(described, settings, data)
    program = hmi_problem_of(prepared, data, described, settings, HMI_CAUSES).program
    return Bench(described, prepared, program, fine, fine)


def measured(bench: Bench, condition: Condition, seed: int, *, strength: float | None = None) -> tuple[HmiData, dict]:
    """One data set, and its key; of a strength, where it is known already."""
    with tempfile.TemporaryDirectory() as folder:
        data, key = Path(folder) / "data.csv", Path(folder) / "key.json"
        blind.write(
            data, key, fine=bench.fine, ruler=bench.ruler, seed=seed, name=condition.name,
            d_prime=condition.d_prime, noise=condition.noise, size=condition.size, strength=strength,
        )  # fmt: skip
        return read_hmi(data), json.loads(key.read_text())


def diagnosed(bench: Bench, data: HmiData, seed: int, *, removed: str = "") -> Diagnosis:
    """The diagnosis of one data set, without the held-out gain."""
    library = [cause for cause in HMI_CAUSES if cause.name != removed]
    return diagnose_hmi(
        data, bench.described, causes=library, seed=seed, gain=False, prepared=bench.prepared, program=bench.program
    )


def design(bench: Bench, seed: int) -> Design:
    """A data set in which nothing is hidden, linearised about its fit."""
    found = diagnosed(bench, measured(bench, Condition("null", "none", 0.0), seed)[0], seed)
    account = found.account
    assert isinstance(account, HmiAccount)
    assert found.decision is not None
    problem, null, tested = account.problem, account.null, found.decision.omnibus.alternatives
    looked_for = problem.alternatives(null.unknowns, null.directions, noise_size(null))
    names, kept = {one.name for one in looked_for}, {(one.name, one.shape, one.sign) for one in tested}
    return Design(
        _with_beliefs_of(blind.NOISE, problem, null),
        [one for one in looked_for if (one.name, one.shape, one.sign) in kept],
        {
            name: {sign: _truth(problem, looked_for, name, null, sign) for sign in _signs(name)}
            for name in blind.EFFECTS
        },
        problem.noise_family(),
        [one for one in tested if one.name not in names],
        of_all_data(hmi_local_forms(problem.rows), problem.weights, len(null.directions)),
        problem.rows.temperature,
    )


def _with_beliefs_of(size: float, problem: HmiDiagnosisProblem, null: HmiFit) -> np.ndarray:
    """Directions of a fit, what is believed in units of noise of another size than the one that the fit found."""
    directions, readings = null.directions.copy(), len(null.of_readings)
    slopes = problem.program.penalty_slopes(null.unknowns)[:, problem.program.constants]
    directions[readings:] *= size * np.linalg.norm(slopes) / np.linalg.norm(directions[readings:])
    return directions


def _signs(name: str) -> tuple[int, ...]:
    """Of strengths that the generator hides."""
    return (1, -1) if name in blind.BOTH_WAYS else (1,)


def _truth(problem: HmiDiagnosisProblem, looked_for: list[Effect], name: str, null: HmiFit, sign: int) -> np.ndarray:
    """The effect of d' = 1 of either sign, as the generator has it: in its shape, by readings alone, constants free."""
    program, place = problem.program, problem.program.place(name)
    mine = [one for one in looked_for if one.name == name and one.reach * sign > 0.0]
    shape = TRUE_SHAPES.get(name, program.causes[place].shapes[0])
    nearest = min(mine, key=lambda one: abs((one.shape or 0.0) - shape))
    at = null.unknowns.copy()
    at[len(program.causes) + place] = shape
    reach = nearest.reach / program.causes[place].plausible
    effect = np.zeros((len(null.directions), 1))
    readings = len(null.of_readings)
    effect[:readings, 0] = sign * problem.weights * program.secant(at, place, reach, program.predict(null.unknowns))
    return effect / projected_length(effect[:readings], null.directions[:readings])


def implausible(name: str, strength: float) -> str:
    """Why a strength is one that there cannot be, so that it is not studied; nothing if there can."""
    cause = next((cause for cause in HMI_CAUSES if cause.name == name), None)
    if cause is None or abs(strength) <= MOST_IMPLAUSIBLE * cause.plausible:
        return ""
    return f"it takes a strength of {strength:.3g}, where {cause.plausible:.3g} is plausible."


def one_set(condition: Condition, seed: int, bench: Bench | None = None) -> dict:
    """What the diagnosis says of one data set, as a line of the record; by this process's bench if none is given."""
    bench = prepared_bench() if bench is None else bench
    try:
        data, hidden = measured(bench, condition, seed)
    except NoSuchEffect as impossible:
        return dataclasses.asdict(condition) | {"seed": seed, "verdict": NO_DATA, "why": str(impossible)}
    if why := implausible(condition.name, hidden["strength"]):
        return dataclasses.asdict(condition) | {"seed": seed, "verdict": NO_DATA, "why": why}
    begun = time.perf_counter()
    found = diagnosed(bench, data, seed, removed=condition.name if condition.part == "removed" else "")
    line = dataclasses.asdict(condition) | {
        "seed": seed,
        "strength": hidden["strength"],
        "verdict": found.verdict,
        "seconds": time.perf_counter() - begun,
    }
    decision = found.decision
    if decision is None:
        return line | {"first": "", "named": [], "confusable": [], "possible": [], "audit": list(found.audit)}
    ranked = [one.cause.name for one in found.causes]
    line |= {
        "p": decision.omnibus.p_value,
        "first": ranked[0] if ranked else "",
        "named": list(decision.named),
        "confusable": list(decision.confusable),
        "possible": list(decision.possible),
        "left": decision.candidates,
        "testable": condition.name in ranked,
    }
    own = next((one for one in found.causes if one.cause.name == condition.name), None)
    if condition.part == "known" and own is not None and condition.name in decision.candidates:
        line |= {
            "estimate": own.estimate,
            "interval": list(own.interval),
            "covered": own.interval[0] <= hidden["strength"] <= own.interval[1],
        }
    return line


def planned(sets: int, development: bool) -> list[tuple[Condition, int]]:
    """Conditions and seeds, a round of all conditions after the other."""
    first, each = (200, 100) if development else (FIRST_TEST_SEED, 1000)
    return [
        (condition, first + each * place + number)
        for number in range(sets)
        for place, condition in enumerate(conditions())
    ]


def main() -> None:
    """Measure and sum up."""
    given = arguments(__doc__, out="diagnosis_hmi.jsonl", sets=1).parse_args()
    jax.config.update("jax_enable_x64", True)
    todo = planned(given.sets, given.development)
    lines = recorded(one_set, todo, given, stamp(SOURCES))
    # Limits are of the sets that are summed up, which may be of other seeds than those of today.
    first = min((line["seed"] for line in lines), default=todo[0][1])
    summary = {
        "benchmark": "diagnosis_hmi",
        "seeds": "development" if given.development else "test",
        "code": code_of(lines, stamp(SOURCES)),
        **summarise(lines, limits([design(prepared_bench(), first - 1)], STRENGTHS)),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.with_suffix(".json").write_text(json.dumps(summary, indent=2) + "\n")
    if given.docs is not None:
        write_docs(summary, given.docs, HMI_STUDY)


if __name__ == "__main__":
    main()
