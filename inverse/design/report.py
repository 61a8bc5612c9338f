"""A design in words and as JSON."""

from typing import Any

from inverse.design.design import Design
from inverse.design.separation import Separation
from inverse.software import versions

SCHEMA_VERSION = 1
"""Of design.json; keys do not change without a new number."""


def as_json(design: Design) -> dict[str, Any]:
    """What design.json holds."""
    return {
        "schema_version": SCHEMA_VERSION,
        "causes": design.causes,
        "now": _separation(design.now),
        "proposals": [
            {
                "name": one.proposal.name,
                "words": one.proposal.words,
                "readings": len(one.proposal),
                "seconds": one.proposal.seconds,
                **_separation(one.separation),
            }
            for one in design.rated
        ],
        "notes": list(design.notes),
        "checks": [{"hidden": one.hidden, "verdict": one.verdict, "named": list(one.named)} for one in design.checks],
        "noise": design.size,
        "seed": design.seed,
        "versions": versions(),
    }


def _separation(found: Separation) -> dict[str, Any]:
    return {
        "probability_right": found.worst,
        "d_prime": dict(zip(found.names, map(float, found.d_prime), strict=True)),
        "cosine": [[float(value) for value in row] for row in found.cosine],
    }


def report(design: Design, name: str) -> str:
    """The report in Markdown."""
    listed = ", ".join(f"{cause} ({strength:.3g})" for cause, strength in design.causes.items())
    best = design.rated[0]
    lines = [
        f"# What to measure next after {name}",
        "",
        f"To be told apart: {listed}. With what there is, the right one of two looks likelier in "
        f"{100.0 * design.now.worst:.0f} % of cases at least; with {best.proposal.words}, in "
        f"{100.0 * best.separation.worst:.0f} %.",
        "",
        f"| measurement | readings | least probability of the right one | {' | '.join(design.now.names)} |",
        f"| --- | ---: | ---: |{' ---: |' * len(design.now.names)}",
        _row("nothing more", "", design.now),
        *(_row(one.proposal.words, str(len(one.proposal)), one.separation) for one in design.rated),
        "",
        f"Under each cause: its d', with noise of {100.0 * design.size:.2g} % as in these data. Strengths are those "
        "estimated, but none below what the data that there are would show. One that counts over a whole "
        "measurement, as that of drying does, counts over the longer one.",
        "",
    ]
    lines += [line for note in design.notes for line in (note, "")]
    if design.checks:
        lines += [f"## {best.proposal.name}, simulated and diagnosed again", "", "| put in | verdict | named |"]
        lines += ["| --- | --- | --- |"]
        lines += [f"| {one.hidden} | {one.verdict} | {', '.join(one.named) or '-'} |" for one in design.checks]
        lines += [""]
    return "\n".join(lines)


def _row(words: str, readings: str, found: Separation) -> str:
    values = " | ".join(f"{value:.1f}" for value in found.d_prime)
    return f"| {words} | {readings} | {100.0 * found.worst:.0f} % | {values} |"
