"""How often the diagnosis is right: detection, attribution and false alarms on data sets with hidden effects.

python -m benchmarks.diagnosis --quick                       # minutes
python -m benchmarks.diagnosis --workers 8                   # by eight processes at once
python -m benchmarks.diagnosis --model zener                 # of conventional solids, by the conventional model
python -m benchmarks.diagnosis --out benchmarks/records/diagnosis.jsonl --docs docs   # record kept; table, figure

The data come from `tests/blind`, which shares no code with the package, on seeds that chose no threshold
(`--development` takes the others). Every data set is one line of `--out`, so that a run can be stopped at any time;
what is there is summed up beside it. Sets are taken from all conditions in turn.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import dataclasses
import json
import platform
import tempfile
import time
from pathlib import Path

import jax
import numpy as np

import arfjax as ax
from benchmarks.diagnosis_docs import write_docs
from benchmarks.diagnosis_limits import dma_design, limits
from benchmarks.diagnosis_record import (
    FIRST_TEST_SEED,
    arguments,
    code_of,
    lines_of,
    recorded,
    stamp,
)
from benchmarks.diagnosis_rests import removed_limits
from benchmarks.diagnosis_studies import DMA_STUDY, ZENER_STUDY
from benchmarks.diagnosis_summary import NO_DATA, summarise
from inverse.datasets.dma import read_dma
from inverse.diagnosed import MODELS
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.dma.examination import examine_dma
from inverse.diagnosis.dma.problem import DmaProblem, dma_problem
from inverse.diagnosis.examination import Examined
from tests.blind import dma_generator as blind
from tests.blind.no_such_effect import NoSuchEffect

STUDIES = {"fractional": DMA_STUDY, "zener": ZENER_STUDY}
"""By the model that is fitted, which the solids are of."""
_RECORDS = {"fractional": "diagnosis.jsonl", "zener": "diagnosis_zener.jsonl"}
NOISES = ("white", "tails", "correlated-0.3", "correlated-0.6", "loud", "understated")
NOISES_IN_TIME = tuple(f"{blind.IN_TIME}-{rho}" for rho in (0.3, 0.6))
STRENGTHS = (3.0, 4.5, 6.0)
UNKNOWN_STRENGTHS = (5.0, 9.0)
UNEQUAL_STRENGTH = 4.5
"""Of known causes in noise of which magnitude and phase are unequal."""
QUICK_SETS = 2
NULL_SETS = 16
"""In a round without an effect: a false alarm takes many sets to count and little time each."""
SOURCES = (
    "inverse/diagnosis/*.py",
    "inverse/diagnosis/dma/*.py",
    "inverse/diagnosis/dma/causes/*.py",
    "tests/blind/dma_generator.py",
)
"""Code that a record depends on; what it is built upon changes seldom, and says so in CHANGELOG.md."""
_FIRST_SEED = {"fractional": FIRST_TEST_SEED, "zener": 3_600_000}
"""Of rates, by model; curves have seeds below those."""
_SEEDS_A_CONDITION = 1000
_DEVELOPMENT_SEEDS_A_CONDITION = 200


@dataclasses.dataclass(frozen=True)
class Condition:
    """What is hidden, and how.

    Attributes:
        part: Of the study: `known`, `null`, `unknown`, `removed`, or `unequal` for known causes in that noise.
        name: Hidden effect; the cause is taken out of the library in `removed`.
        d_prime: Its strength; 0 where nothing is hidden.
        noise: Kind.
        share: Data sets in each round.
        model: That is fitted.
    """

    part: str
    name: str
    d_prime: float
    noise: str
    share: int
    model: str = "fractional"


def testable(model: str) -> list[str]:
    """Effects that a fit of the solid does not imitate."""
    return blind.shown(conventional=not MODELS[model].fractional)


def conditions(model: str = "fractional") -> list[Condition]:
    """All of them; the place in this list fixes the seeds."""

    def condition(part: str, name: str, d_prime: float, noise: str = "white", share: int = 1) -> Condition:
        return Condition(part, name, d_prime, noise, share, model)

    known = [condition("known", name, d) for d in STRENGTHS for name in testable(model)]
    null, in_time = (
        [condition("null", "none", 0.0, noise, NULL_SETS) for noise in noises] for noises in (NOISES, NOISES_IN_TIME)
    )
    unknown = [condition("unknown", name, d, share=2) for d in UNKNOWN_STRENGTHS for name in blind.UNKNOWN]
    removed = [condition("removed", name, d) for d in UNKNOWN_STRENGTHS for name in testable(model)]
    unequal = [
        condition("null", "none", 0.0, blind.UNEQUAL, NULL_SETS),
        *(condition("unequal", name, UNEQUAL_STRENGTH, blind.UNEQUAL) for name in testable(model)),
    ]
    return [*known, *null, *unknown, *removed, *in_time, *unequal]


def measured(seed: int, model: str = "fractional", **hidden) -> tuple[DmaProblem, dict]:
    """One data set, fitted, and its key."""
    with tempfile.TemporaryDirectory() as folder:
        data, key = Path(folder) / "data.csv", Path(folder) / "key.json"
        blind.write(data, key, seed=seed, conventional=not MODELS[model].fractional, **hidden)
        return dma_problem(read_dma(data), MODELS[model]), json.loads(key.read_text())


def one_set(condition: Condition, seed: int) -> dict:
    """What the diagnosis says of one data set, as a line of the record."""
    begun = time.perf_counter()
    hidden = {"name": condition.name, "d_prime": condition.d_prime, "noise": condition.noise}
    try:
        problem, key = measured(seed, condition.model, **hidden)
    except NoSuchEffect as impossible:
        return dataclasses.asdict(condition) | {"seed": seed, "verdict": NO_DATA, "why": str(impossible)}
    removed = condition.name if condition.part == "removed" else ""
    library = [cause for cause in DMA_CAUSES if cause.name != removed]
    found = examine_dma(problem, library, np.random.default_rng(seed), program=DMA_CAUSES)
    decision = found.decision
    ranked = decision.ranked(list(dict.fromkeys(a.name for a in found.seen)))
    line = dataclasses.asdict(condition) | {
        "seed": seed,
        "verdict": decision.verdict,
        "p": decision.omnibus.p_value,
        "first": ranked[0] if ranked else "",
        "named": list(decision.named),
        "confusable": list(decision.confusable),
        "explanations": [list(names) for names in decision.explanations],
        "possible": list(decision.possible),
        "misfits": decision.misfits,
        "by score": decision.omnibus.ranked(list(dict.fromkeys(a.name for a in found.seen)))[:3],
        "left": decision.candidates,
        "testable": condition.name in {alternative.name for alternative in found.seen},
    }
    if condition.part in ("known", "unequal") and condition.name in decision.candidates:
        line |= _strength(found, condition.name, key)
    return line | {"seconds": round(time.perf_counter() - begun, 2)}


def _strength(found: Examined, name: str, key: dict) -> dict:
    """Interval of the hidden strength, and whether the key lies in it."""
    extension = found.extension(name)
    noise = found.family[found.decision.tests[name].null_noise]
    start = found.linear_strengths((extension,))
    refit = found.fit((extension,), noise, start, True)
    hidden = key["strength_of_readings"]
    lower, upper = (float(end) for end in refit.intervals[0])
    return {
        "strength": hidden,
        "estimate": float(refit.strengths[0]),
        "interval": [lower, upper],
        "covered": lower <= hidden <= upper,
    }


def _weighed(problem: DmaProblem, seed: int) -> DmaProblem:
    """By noise of magnitude and phase that are as unequal as the seed draws them."""
    return dataclasses.replace(problem, weights=problem.weights / np.array(blind.parts_of(blind.UNEQUAL, seed)))


def _seed(place: int, number: int, development: bool, model: str = "fractional") -> int:
    if number >= (_DEVELOPMENT_SEEDS_A_CONDITION if development else _SEEDS_A_CONDITION):
        raise SystemExit("--sets: so many rounds would take seeds of other conditions; ask for fewer.")
    if development:
        return 200 + _DEVELOPMENT_SEEDS_A_CONDITION * place + number
    return _FIRST_SEED[model] + _SEEDS_A_CONDITION * place + number


def planned(sets: int, development: bool, model: str = "fractional") -> list[tuple[Condition, int]]:
    """Conditions and seeds, a round of all conditions after the other."""
    return [
        (condition, _seed(place, number * condition.share + part, development, model))
        for number in range(sets)
        for place, condition in enumerate(conditions(model))
        for part in range(condition.share)
    ]


def _require_of_model(out: Path, model: str) -> None:
    """Stop before rates of two solids are mixed; lines that name no model are of the fractional one."""
    lines = lines_of(out) if out.exists() else []
    if others := {line.get("model", "fractional") for line in lines} - {model}:
        raise SystemExit(f"{out}: has data sets of the model {others.pop()}, not {model}; give another file as --out.")


def main() -> None:
    """Measure, sum up and write."""
    parser = arguments(__doc__, out="diagnosis.jsonl", sets=25)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_SETS} rounds")
    parser.add_argument("--model", choices=list(STUDIES), default="fractional", help="solid; each has its own record")
    parser.set_defaults(out=None)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    sets, model = QUICK_SETS if given.quick else given.sets, given.model
    given.out = given.out or Path("results/benchmarks") / _RECORDS[model]
    _require_of_model(given.out, model)
    lines = recorded(one_set, planned(sets, given.development, model), given, stamp(SOURCES))

    def fitted(place: int, **hidden) -> DmaProblem:
        return measured(_seed(place, 0, given.development, model), model, **hidden)[0]

    def quiet(name: str, d_prime: float) -> tuple[DmaProblem, float]:
        size = blind.noise_size(conventional=not MODELS[model].fractional)
        return fitted(0, name=name, d_prime=d_prime, noise="none"), size

    designs = [dma_design(fitted(place, name="none")) for place in range(5)]
    weighed = [
        dma_design(_weighed(fitted(place, name="none"), _seed(place, 0, given.development, model)))
        for place in range(5)
    ]
    summary = {
        "benchmark": "diagnosis",
        "model": model,
        "seeds": "development" if given.development else "test",
        "code": code_of(lines, stamp(SOURCES)),
        **summarise(
            lines,
            limits(designs, STRENGTHS),
            removed_limits(quiet, testable(model), UNKNOWN_STRENGTHS),
            in_unequal=limits(weighed, [UNEQUAL_STRENGTH]),
        ),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.with_suffix(".json").write_text(json.dumps(summary, indent=2) + "\n")
    if given.docs is not None:
        write_docs(summary, given.docs, STUDIES[model])


if __name__ == "__main__":
    main()
