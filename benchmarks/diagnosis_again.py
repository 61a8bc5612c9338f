"""Recorded data sets judged anew: whether the code that is here answers as that of the record did.

python -m benchmarks.diagnosis_again benchmarks/records/diagnosis.jsonl --sets 300 --workers 2

After a change that is meant to change no answer, this takes minutes where new rates take hours. It shows what the
change does on data sets that were looked at, and gives no rates. It needs the record of a study that was run before.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

from benchmarks import diagnosis, diagnosis_hmi
from benchmarks.diagnosis_record import lines_of
from benchmarks.spread import spread

ANSWER = ("verdict", "first", "named", "confusable", "possible", "testable")
"""What has to be the same, key by key."""


def judged(line: dict[str, Any]) -> dict[str, Any]:
    """The line that the code here makes of the data set of another."""
    if "model" in line:
        return diagnosis.one_set(_condition(diagnosis.Condition, line), line["seed"])
    return diagnosis_hmi.one_set(_condition(diagnosis_hmi.Condition, line), line["seed"])


def _condition(kind: type[Any], line: dict[str, Any]) -> Any:
    return kind(**{field.name: line[field.name] for field in dataclasses.fields(kind)})


def some_of(lines: Sequence[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    """So many lines, evenly from the whole record; all, if there are no more.

    Args:
        lines: Of the record.
        count: How many.
    """
    step = max(len(lines) / count, 1.0)
    return [lines[int(step * number)] for number in range(min(count, len(lines)))]


def differences(before: dict[str, Any], after: dict[str, Any]) -> dict[str, list[Any]]:
    """Answers to one data set that differ, before and after."""
    return {key: [before.get(key), after.get(key)] for key in ANSWER if before.get(key) != after.get(key)}


def compared(before: Sequence[dict[str, Any]], after: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """How many answers differ, which, and by how much p-values do at most, relative to themselves."""
    old = {(line["part"], line["seed"]): line for line in before}
    pairs = [(old[line["part"], line["seed"]], line) for line in after]
    changes = [abs(two["p"] / one["p"] - 1.0) for one, two in pairs if one.get("p") and two.get("p")]
    return {
        "data sets": len(pairs),
        "largest change of p": max(changes, default=0.0),
        "differing": [{"seed": one["seed"], **found} for one, two in pairs if (found := differences(one, two))],
    }


def main() -> None:
    """Judge and say what differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("record", type=Path, help="lines of `benchmarks.diagnosis` or `benchmarks.diagnosis_hmi`")
    parser.add_argument("--sets", type=int, default=300, help="data sets")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    before = some_of(lines_of(given.record), given.sets)
    after = list(spread(judged, [(line,) for line in before], workers=given.workers))
    print(json.dumps(compared(before, after), indent=2))


if __name__ == "__main__":
    main()
