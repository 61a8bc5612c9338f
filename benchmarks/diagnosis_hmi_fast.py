"""How often the decision is right about curves of displacement, on linear data, nothing refitted.

python -m benchmarks.diagnosis_hmi_fast --docs docs --workers 2

A few fits of simulated sonications in which nothing is hidden are linearised. Each data set is noise of the readings
and of what is believed of the constants, and at most one effect; a cause is put into the model by its direction. The
decision is the one of `diagnose_hmi`, so that these rates show what it makes of an effect (a large one may be named
beside what it leaves, and noise found wrong, only after it); `benchmarks.diagnosis_hmi` shows on fewer sets what
simulating, refitting and other meshes do to that. `--share 0.1` takes minutes.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import json
import platform
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

import arfjax as ax
from benchmarks.diagnosis_docs import write_docs
from benchmarks.diagnosis_hmi import NOISES, SOURCES, STRENGTHS, Bench, Condition, design, prepared_bench
from benchmarks.diagnosis_hmi import conditions as simulated_conditions
from benchmarks.diagnosis_limits import Design, Limits, limits, projected_length
from benchmarks.diagnosis_record import code_of, stamp
from benchmarks.diagnosis_rests import linear_rests
from benchmarks.diagnosis_studies import LINEAR_HMI_STUDY
from benchmarks.diagnosis_summary import summarise
from benchmarks.spread import spread
from inverse.diagnosis.decision import decide
from inverse.diagnosis.hmi.noise_size import size_beside_effect
from inverse.diagnosis.noise import Noise
from inverse.diagnosis.projection import unit_columns
from inverse.diagnosis.rule import UNEXPLAINED_LEVEL
from inverse.diagnosis.screening import Alternative, Screen
from tests.blind import hmi_generator as blind

SETS = {"known": 25, "null": 800, "unknown": 100, "removed": 10}
"""Of each condition."""
DESIGNS = 3
NEAR, NEAR_SPREAD = "-near", 0.6
"""Noise in which constants are as near to their middle as in blind data; in the others they are as is believed."""
UNDERSTATED, UNDERSTATED_BY = "understated", 1.3
"""White noise of readings so many times as large as stated, by which what is believed of constants is weighed."""
WEAK, STRONG = 5.0, 9.0
"""The d' at which effects without a name are to be named wrongly seldom, and that of curves that are simulated."""
_AT_ONCE = 20
_FITS = 3
"""By turns with the size of what they leave, against which beliefs are weighed; as in `diagnose_hmi`."""
_FIRST_SEED = {False: 2_660_000, True: 200}
"""By whether they are for development. Test seeds below this were looked at with earlier code, or others have them."""


def conditions() -> list[Condition]:
    """Those of curves that are simulated, and what these are too few for; the place in this list fixes the seeds."""
    simulated = simulated_conditions()
    other_noises = (*(noise + NEAR for noise in NOISES), UNDERSTATED, UNDERSTATED + NEAR)
    nameless = (one for one in simulated if one.part in ("unknown", "removed"))
    return [
        *simulated,
        *(Condition("null", "none", 0.0, noise) for noise in other_noises),
        *(dataclasses.replace(one, d_prime=WEAK) for one in nameless),
    ]


def some_sets(designs: Sequence[Design], condition: Condition, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """What the decision says of some data sets of one condition, designs taken in turn, as lines of a record."""
    return [_one_set(designs[seed % len(designs)], condition, seed) for seed in seeds]


def _one_set(about: Design, condition: Condition, seed: int) -> dict[str, Any]:
    begun, rng = time.perf_counter(), np.random.default_rng([seed, 20261123])
    removed = condition.name if condition.part == "removed" else ""
    causes = [one for one in about.alternatives if one.name != removed]
    data, fitted = _drawn(about, condition, seed, rng), about.fitted
    if condition.noise.removesuffix(NEAR) != UNDERSTATED:
        data, fitted = _weighed(data, fitted, about.family, causes)
    basis = np.linalg.qr(unit_columns(fitted))[0]
    left = data - basis @ (basis.T @ data)
    found = decide(left, fitted, causes, about.free_forms, about.family, rng, few=True, local_forms=about.local_forms)
    names = list(dict.fromkeys(one.name for one in causes))
    ranked = found.ranked(names)
    return dataclasses.asdict(condition) | {
        "seed": seed,
        "verdict": found.verdict,
        "p": found.omnibus.p_value,
        "first": ranked[0] if ranked else "",
        "named": list(found.named),
        "confusable": list(found.confusable),
        "possible": list(found.possible),
        "testable": condition.name in names,
        "seconds": time.perf_counter() - begun,
    }


def _drawn(about: Design, condition: Condition, seed: int, rng: np.random.Generator) -> Float[np.ndarray, " datum"]:
    """Noise of readings, then of beliefs, and the effect."""
    assert about.temperature is not None
    beliefs = len(about.fitted) - len(about.temperature)
    nearness = NEAR_SPREAD if condition.noise.endswith(NEAR) else 1.0
    kind = condition.noise.removesuffix(NEAR)
    drawn = blind.draw_noise(kind, about.temperature, rng) * (UNDERSTATED_BY if kind == UNDERSTATED else 1.0)
    noise = np.append(drawn, nearness * rng.standard_normal(beliefs))
    effect = np.zeros(len(noise))
    if condition.name in about.truths:
        effect = about.truths[condition.name][int(blind.sign_of(condition.name, seed))][:, 0]
    elif condition.name in blind.UNKNOWN:
        effect = _nameless(about, condition.name, rng)
    return condition.size * (noise + condition.d_prime * effect)


def _weighed(
    data: Float[np.ndarray, " datum"],
    fitted: Float[np.ndarray, "datum p"],
    family: Sequence[Noise],
    causes: Sequence[Alternative],
) -> tuple[Float[np.ndarray, " datum"], Float[np.ndarray, "datum p"]]:
    """Data and directions with beliefs weighed against the noise that a diagnosis finds, of which nobody tells it."""
    belief, size = np.arange(len(data)) >= len(data) - family[0].beliefs, blind.NOISE

    def against(size: float):
        weights = np.where(belief, size / blind.NOISE, 1.0)
        return weights * data, weights[:, None] * fitted

    for _ in range(_FITS):
        weighed, directions = against(size)
        size = Screen(directions, (), family[:1]).of_readings(weighed)[0]
    return against(size_beside_effect(*against(size), family, causes, size))


def _nameless(about: Design, name: str, rng: np.random.Generator) -> Float[np.ndarray, " datum"]:
    """An effect of d' = 1 that is in no list, as the generator has it: by readings alone, constants free."""
    assert about.temperature is not None
    effect, readings = np.zeros(len(about.fitted)), len(about.temperature)
    effect[:readings] = blind.UNKNOWN[name](about.temperature, rng)
    return effect / projected_length(effect[:readings, None], about.fitted[:readings])


def rests(designs: Sequence[Design], *, draws: int = 20) -> list[Limits]:
    """What other causes leave of causes taken out, and all causes of effects in no list."""
    rng = np.random.default_rng(0)
    taken_out = [
        {name: [one[:, 0] for one in signs.values()] for name, signs in design.truths.items()} for design in designs
    ]
    nameless = [
        {name: [_nameless(design, name, rng) for _ in range(draws)] for name in blind.UNKNOWN} for design in designs
    ]
    return [
        linear_rests(designs, effects, (WEAK, STRONG), level=UNEXPLAINED_LEVEL) for effects in (taken_out, nameless)
    ]


def planned(share: float, development: bool) -> list[tuple[Condition, range]]:
    """Conditions and seeds, some sets at a time.

    Raises:
        ValueError: if the share is not from 0 to 1: conditions would share seeds.
    """
    if not 0.0 < share <= 1.0:
        raise ValueError(f"the share of all data sets must be above 0 and at most 1, got {share}.")
    todo, first = [], _FIRST_SEED[development]
    for condition in conditions():
        end = first + max(round(share * SETS[condition.part]), 1)
        todo += [(condition, range(seed, min(seed + _AT_ONCE, end))) for seed in range(first, end, _AT_ONCE)]
        first += SETS[condition.part]
    return todo


def measured_designs(bench: Bench, development: bool) -> list[Design]:
    """About fits to different data sets in which nothing is hidden."""
    first = _FIRST_SEED[development]
    return [design(bench, seed) for seed in range(first - DESIGNS, first)]


def main() -> None:
    """Measure and sum up."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks/diagnosis_hmi_fast.json"))
    parser.add_argument("--share", type=float, default=1.0, help="of all data sets")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--development", action="store_true", help="seeds on which things may be tried")
    parser.add_argument("--docs", type=Path, help="folder for the table and the figure")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    designs = measured_designs(prepared_bench(), given.development)
    todo = [(designs, *piece) for piece in planned(given.share, given.development)]
    made_by = stamp(SOURCES)
    lines = [line | {"stamp": made_by} for part in spread(some_sets, todo, workers=given.workers) for line in part]
    summary = {
        "benchmark": "diagnosis_hmi_fast",
        "seeds": "development" if given.development else "test",
        "code": code_of(lines, made_by),
        **summarise(lines, limits(designs, STRENGTHS), *rests(designs)),
        "versions": {"arfjax": ax.__version__, "jax": jax.__version__, "python": platform.python_version()},
    }
    given.out.parent.mkdir(parents=True, exist_ok=True)
    given.out.write_text(json.dumps(summary, indent=2) + "\n")
    if given.docs is not None:
        part = "" if given.share == 1.0 else f" --share {given.share:g}"
        write_docs(summary, given.docs, dataclasses.replace(LINEAR_HMI_STUDY, command=LINEAR_HMI_STUDY.command + part))


if __name__ == "__main__":
    main()
