"""A design in words and as JSON."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from inverse.design.design import Design
from inverse.design.dma_information import Information
from inverse.design.separation import Separation
from inverse.software import versions

SCHEMA_VERSION = 4
"""Of design.json; keys do not change without a new number."""
_TWENTY_TO_ONE = 3.0
"""Nat."""
_MANY = 1000.0


def as_json(design: Design) -> dict[str, Any]:
    """What design.json holds."""
    return {
        "schema_version": SCHEMA_VERSION,
        "verdict": design.verdict,
        "causes": design.causes,
        "now": _separation(design.now),
        "proposals": [
            {
                "name": one.proposal.name,
                "words": one.proposal.words,
                "readings": len(one.proposal),
                "seconds": one.proposal.seconds,
                "protocol": one.proposal.keys,
                **_separation(one.separation),
            }
            for one in design.rated
        ],
        "reading": _reading(design),
        "notes": list(design.notes),
        "checks": [
            {
                "hidden": one.hidden,
                "verdict": one.verdict,
                "named": list(one.named),
                "confusable": list(one.confusable),
            }
            for one in design.checks
        ],
        "noise": list(design.sizes),
        "seed": design.seed,
        "versions": versions(),
    }


def in_short(design: Design) -> dict[str, Any]:
    """The causes, how well the data that there are separate them, and which further measurement does best: JSON."""
    best = design.rated[0] if design.rated else None
    return {
        "causes": list(design.now.names),
        "angle_deg": design.now.angle,
        "probability_right": design.now.worst,
        "measurement": None
        if best is None
        else {
            "name": best.proposal.name,
            "words": best.proposal.words,
            "readings": len(best.proposal),
            "seconds": best.proposal.seconds,
            "angle_deg": best.separation.angle,
            "probability_right": best.separation.worst,
        },
    }


def in_words(design: Design) -> list[str]:
    """The same for a report."""
    if not design.rated:
        return list(design.notes)
    short = in_short(design)
    listed = " and ".join([", ".join(short["causes"][:-1]), short["causes"][-1]])
    now = (
        f"What {listed} do to these data, fitted constants taken off, is as little as {short['angle_deg']:.0f} degrees "
        f"apart: each as strong as estimated, or as would surely be seen, the right one of two would look likelier in "
        f"{percent(short['probability_right'])} of cases at least if noise were white, which does not prove it."
    )
    best = short["measurement"]
    if best["probability_right"] <= short["probability_right"]:
        return [f"{now} None of {len(design.rated)} measurements that could be made next separates them better."]
    return [
        f"{now} Of {len(design.rated)} measurements that could be made next, {best['words']} separates them best: "
        f"{best['angle_deg']:.0f} degrees, {percent(best['probability_right'])}. `arfjax design` lists them all, "
        "simulates the best, and diagnoses it again."
    ]


def _reading(design: Design) -> dict[str, Any] | None:
    """The single further reading that tells most, and of which causes."""
    found = design.information
    if found is None:
        return None
    return {
        "causes": list(found.causes),
        "temperature_c": found.best_temperature,
        "frequency_hz": found.best_frequency,
        "information_nat": found.best,
    }


def _noise(design: Design) -> str:
    """In words; magnitude and phase apart where they differ."""
    first = f"{100.0 * design.sizes[0]:.2g} %"
    if len(set(design.sizes)) == 1:
        return first
    return f"{first} in the magnitude and {1e3 * design.sizes[1]:.2g} mrad in the phase"


def _information(found: Information | None) -> list[str]:
    """The same in a sentence."""
    if found is None:
        return []
    needed = np.ceil(_TWENTY_TO_ONE / max(found.best, 1e-300))
    enough = "no more than one" if needed == 1.0 else f"{needed:.0f} such or more" if needed < _MANY else "too many"
    one, other = found.causes
    return [
        f"A single reading would tell {one} from {other} best at {found.best_temperature:.0f} degC and "
        f"{found.best_frequency:.3g} Hz, as the first of another sweep: it is expected to favour the true one by "
        f"{found.best:.2g} nat. Twenty to one takes {enough}.",
        "",
    ]


def percent(probability: float) -> str:
    """In words, in which nothing is certain."""
    return "more than 99 %" if probability > 0.995 else f"{100.0 * probability:.0f} %"


def _separation(found: Separation) -> dict[str, Any]:
    return {
        "probability_right": found.worst,
        "angle_deg": found.angle,
        "d_prime": dict(zip(found.names, map(float, found.d_prime), strict=True)),
        "cosine": [[float(value) for value in row] for row in found.cosine],
    }


def report(design: Design, name: str, figures: Sequence[str] = ()) -> str:
    """The report in Markdown.

    Args:
        design: What is reported.
        name: Of the data.
        figures: Names of their files.
    """
    listed = ", ".join(f"{cause} ({strength:.3g})" for cause, strength in design.causes.items())
    if not design.rated:
        return "\n".join([f"# What to measure next after {name}", "", *design.notes, ""])
    best = design.rated[0]
    lines = [
        f"# What to measure next after {name}",
        "",
        f"To be told apart: {listed}. With what there is, the right one of two looks likelier in "
        f"{percent(design.now.worst)} of cases at least; with {best.proposal.words}, in "
        f"{percent(best.separation.worst)}.",
        "",
        f"| measurement | readings | least probability of the right one | {' | '.join(design.now.names)} |",
        f"| --- | ---: | ---: |{' ---: |' * len(design.now.names)}",
        _row("nothing more", "", design.now),
        *(_row(one.proposal.words, str(len(one.proposal)), one.separation) for one in design.rated),
        "",
        f"Under each cause: its d', with noise of {_noise(design)} as in these data. Strengths are those "
        "estimated, but none below what the data that there are would show. One that counts in what was "
        "measured, as that of drying does, counts in these data, not in the longer measurement.",
        "",
    ]
    lines += _keys(best.proposal.keys)
    lines += [f"![{figure}]({figure})" for figure in figures] + [""] + _information(design.information)
    lines += [line for note in design.notes for line in (note, "")]
    if design.checks:
        lines += [f"## {best.proposal.name}, simulated and diagnosed again", "", "| put in | verdict | said |"]
        lines += ["| --- | --- | --- |"]
        lines += [
            f"| {one.hidden} | {one.verdict} | {', '.join(one.named) or ' or '.join(one.confusable) or '-'} |"
            for one in design.checks
        ]
        lines += [""]
    return "\n".join(lines)


def _keys(keys: dict[str, float | str]) -> list[str]:
    """What an experiment file says of a proposal."""
    if not keys:
        return []
    listed = ", ".join(f"`{key} = {json.dumps(value)}`" for key, value in keys.items())
    return [
        f"In the experiment file of the first: {listed}. A file has one protocol: sonications of another are diagnosed "
        "and calibrated with a file of their own.",
        "",
    ]


def _row(words: str, readings: str, found: Separation) -> str:
    values = " | ".join(f"{value:.1f}" for value in found.d_prime)
    return f"| {words} | {readings} | {percent(found.worst)} | {values} |"
