"""The record of a study of the diagnosis: a line of JSON for every data set, so that a study goes on where it stopped.

Every line has the stamp of the code that made it, and lines of other code are not added to: rates of two codes are
rates of none. A record of one earlier code can still be summed up, which the page then says.
"""

import argparse
import ast
import hashlib
import io
import json
import re
import tokenize
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from benchmarks.spread import spread

ROOT = Path(__file__).parents[1]
FIRST_TEST_SEED = 3_700_000
"""Of rates. Levels were chosen on development seeds: below 20000, 94200 to 108000 (DMA), 200000 to 220399, 260000 to
284319, 400000 to 599999 (linear curves). Others from 120000 to 1799999, of the conventional model from 2000000, of
curves from 1500000 to 2639999, and from 3000000 to 3599999 were test seeds of earlier code, which was changed after a
look at them: a record of changed code begins beyond all seeds that were looked at, unless lines that the change can
reach are judged anew and it was not chosen by them (CHANGELOG says where)."""


REPORTING = (
    "inverse/diagnosis/choice.py",
    "inverse/diagnosis/constants.py",
    "inverse/diagnosis/content.py",
    "inverse/diagnosis/gain.py",
    "inverse/diagnosis/outlying.py",
    "inverse/diagnosis/report.py",
    "inverse/diagnosis/where.py",
    "inverse/diagnosis/dma/account.py",
    "inverse/diagnosis/dma/gain.py",
    "inverse/diagnosis/hmi/account.py",
    "inverse/diagnosis/hmi/features.py",
    "inverse/diagnosis/hmi/gain.py",
    "inverse/diagnosis/hmi/links.py",
)
"""Files that read what is asked for or tell what was decided, and decide nothing: no record depends on them."""
WORDS = ("source", "sentence", "helps", "shape_means")
"""What a cause says of itself to readers alone."""


def stamp(patterns: Sequence[str]) -> str:
    """Of all files that patterns below the repository's root match, but for `REPORTING`: changes with their code."""
    found = hashlib.sha256()
    paths = {path for pattern in patterns for path in ROOT.glob(pattern)}
    for path in sorted(paths - {ROOT / name for name in REPORTING}):
        found.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + code_in(path.read_text()).encode() + b"\0")
    return found.hexdigest()[:12]


def code_in(source: str) -> str:
    """Lines of a module without comments, docstrings, blank ones and `WORDS`, which change nothing that it does."""
    lines = source.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column]
    for node in ast.walk(ast.parse(source)):
        if _only_says(node):
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def _only_says(node: ast.AST) -> TypeGuard[ast.Expr | ast.Assign]:
    """Whether a statement is a text by itself, or one of `WORDS`."""
    if not isinstance(node, ast.Expr | ast.Assign):
        return False
    text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
    named = isinstance(node, ast.Expr) or getattr(node.targets[0], "id", "") in WORDS
    return text and named


def arguments(description: str | None, *, out: str, sets: int) -> argparse.ArgumentParser:
    """What every study is asked for.

    Args:
        description: Of the study.
        out: Record, below the folder that it is run in.
        sets: Rounds, if not said.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks") / out)
    parser.add_argument("--sets", type=int, default=sets, help="rounds: sets of each condition")
    parser.add_argument("--only", default="", help="known, null, unknown, removed, unequal, or a noise")
    parser.add_argument("--minutes", type=float, default=np.inf, help="stop after so long; 0: sum up what there is")
    parser.add_argument("--anew", action="store_true", help="lines of other code give way; mind their seeds")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--development", action="store_true", help="seeds on which things may be tried")
    parser.add_argument("--docs", type=Path, help="folder for the table and the figure")
    return parser


def recorded(
    work: Callable[..., dict[str, Any]],
    todo: Iterable[tuple[Any, int]],
    given: argparse.Namespace,
    made_by: str,
) -> list[dict[str, Any]]:
    """Lines of the record, those that were missing added, unless no time is given for it.

    Args:
        work: Makes the line of one condition and seed.
        todo: Conditions and seeds, those that are done already among them.
        given: What `arguments` read.
        made_by: Stamp of the code.

    With `--anew` lines of other code are dropped; if what they showed changed the code, new seeds have to be chosen.

    Raises:
        SystemExit: if lines were made by other code.
    """
    given.out.parent.mkdir(parents=True, exist_ok=True)
    lines = lines_of(given.out) if given.out.exists() else []
    stamps = {line.get("stamp") for line in lines}
    if given.minutes <= 0.0 and len(stamps) == 1:
        return lines
    if given.anew and given.minutes > 0.0 and stamps - {made_by}:
        lines, stamps = [], set()
        given.out.unlink()
    if stamps - {made_by}:
        raise SystemExit(
            f"{given.out}: has lines that other code than this ({made_by}) made; put the file away, give another one "
            "as --out, begin again with --anew, or sum up what there is with --minutes 0, if it is all of one code."
        )
    done = {(line["part"], line["seed"]) for line in lines}
    missing = [
        one for one in todo if given.only in ("", one[0].part, one[0].noise) and (one[0].part, one[1]) not in done
    ]
    with given.out.open("a") as record:
        for line in spread(work, missing, workers=given.workers, minutes=given.minutes):
            lines.append(line | {"stamp": made_by})
            record.write(json.dumps(lines[-1]) + "\n")
            record.flush()
    return lines


def lines_of(record: Path) -> list[dict[str, Any]]:
    """All lines of a record."""
    return [json.loads(row) for row in record.read_text().splitlines()]


def code_of(lines: Sequence[dict[str, Any]], made_by: str) -> str:
    """Which code made a record, and from which seeds, in two sentences that stay true when the code changes."""
    (found,) = {line.get("stamp") for line in lines} or {made_by}
    seeds = [line["seed"] for line in lines]
    said = f"Seeds from {min(seeds)} to {max(seeds)}. " if seeds else ""
    return (
        f"{said}Judged by code of the stamp {found}: `python -m benchmarks.diagnosis_pages` says whether it has "
        "changed since, CHANGELOG.md in what."
    )


def stamp_on(page: str) -> str:
    """Stamp of the code that a page's rates are of, as `code_of` says it; empty if it says none."""
    said = re.search(r"Judged by code of the stamp (\w+)", page)
    return said[1] if said else ""
