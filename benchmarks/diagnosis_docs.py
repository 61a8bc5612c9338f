"""The operating characteristic as a page of the documentation: one table of what is asked, tables of all, a figure."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.diagnosis_studies import Bound, Study
from benchmarks.diagnosis_summary import SEEN
from inverse.diagnosis.examination import MOST_IMPLAUSIBLE
from inverse.diagnosis.rule import MOST_BESIDE, MOST_INSTEAD, MOST_OF_PAIR, SET_LEVEL, UNEXPLAINED_LEVEL

_COLOURS = {"unexplained": "#2a7f62", "confusable": "#e0b04a", "named": "#c0392b", "not found": "#b8bcc2"}
_WORDS = {
    "unexplained": "called unexplained",
    "confusable": "in a set of names",
    "named": "named",
    "not found": "not found",
}


_BY_ODDS = (
    "if a correction of no name is too probable, by odds, in nats, above "
    f"{MOST_INSTEAD:g} in place of all causes or {MOST_BESIDE:g} beside the one that fits best, or if all are ruled "
    f"out; and if no pair of causes is more probable than that by {-MOST_OF_PAIR:g}"
)

_UNKNOWN = "detected, noise unknown"
_KNOWN_OR_NOT = ("noise known", "noise unknown")

Rate = dict[str, float]


def write_docs(summary: dict[str, Any], folder: Path, study: Study) -> None:
    """Write page and figure.

    Args:
        summary: From `benchmarks.diagnosis` or `benchmarks.diagnosis_hmi`.
        folder: Where to.
        study: What was studied.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figure(summary).savefig(folder / study.picture, dpi=150)
    (folder / study.page).write_text(page(summary, study))


def figure(summary: dict[str, Any]) -> Figure:
    """Power, attribution and false alarms against d', and what becomes of effects without a name."""
    drawn = Figure(figsize=(11.0, 7.4), layout="constrained")
    power, attribution, alarm, strange = drawn.subplots(2, 2).ravel()
    known = summary["all known"]
    strengths = sorted(known, key=float)
    x = [float(d) for d in strengths]
    nothing = summary["null"].get("white")
    _points(power, x, [known[d]["detected"] for d in strengths], "C0", "detected")
    if nothing:
        _points(power, [0.0], [nothing["alarm"]], "C0", None)
    power.plot(x, [known[d]["limit"]["detected"] for d in strengths], "C0--", label="limit, noise known")
    if all(_UNKNOWN in known[d]["limit"] for d in strengths):
        power.plot(x, [known[d]["limit"][_UNKNOWN] for d in strengths], "C0:", label="limit, noise unknown")
    power.axhline(0.05, color="0.6", lw=0.8)
    power.text(6.2, 0.065, "level 5 %", ha="right", va="bottom", color="0.4", fontsize=9)
    power.set(title="Is anything wrong?", ylabel="share of data sets", xlim=(-0.3, 6.4), ylim=(0.0, 1.03))
    _points(attribution, x, [known[d]["first"] for d in strengths], "C0", "right cause ranked first")
    attribution.plot(x, [known[d]["limit"]["first"] for d in strengths], "C0--", label="limit of that, noise known")
    pairs = (
        ("possible, if detected", "C2", "not ruled out, if detected"),
        ("covered", "C1", "strength in its interval"),
    )
    for offset, (key, colour, label) in zip((-0.06, 0.06), pairs, strict=True):
        if any(known[d][key]["sets"] for d in strengths):
            _points(attribution, [d + offset for d in x], [known[d][key] for d in strengths], colour, label)
    attribution.set(title="Which cause?", xlim=(2.6, 6.4), ylim=(min(0.5, attribution.get_ylim()[0]), 1.02))
    for axis in (power, attribution):
        axis.set_xlabel("d': effect left after the fit, over the noise")
    power.legend(loc=(0.02, 0.12), frameon=False)
    attribution.legend(loc="lower right", frameon=False)
    _false_alarms(alarm, {noise: one["alarm"] for noise, one in summary["null"].items()})
    _fates(strange, summary)
    return drawn


def _points(axis: Axes, x: Sequence[float], rates: Sequence[Rate], colour: str, label: str | None) -> None:
    middle, error = [one["rate"] for one in rates], [one["error"] for one in rates]
    axis.errorbar(x, middle, error, fmt="o-", color=colour, label=label, capsize=2.5, ms=4.5)


def _false_alarms(axis: Axes, null: dict[str, Rate]) -> None:
    names = list(null)
    axis.barh(names, [100.0 * null[n]["rate"] for n in names], color="C0", height=0.55)
    axis.errorbar(
        [100.0 * null[n]["rate"] for n in names],
        names,
        xerr=[100.0 * null[n]["error"] for n in names],
        fmt="none",
        ecolor="0.2",
        capsize=3,
    )
    axis.axvline(5.0, color="0.4", lw=0.9)
    axis.axvline(6.0, color="0.4", lw=0.9, ls="--")
    sets = {null[n]["sets"] for n in names}
    count = next(iter(sets)) if len(sets) == 1 else 0
    each = f" ({count} sets each)" if count > 1 else " (one set each)" if count else ""
    axis.set_yticks(range(len(names)), [n if each else f"{n}, n = {null[n]['sets']}" for n in names])
    axis.set(title=f"False alarms, nothing hidden{each}", ylim=(len(names) - 0.4, -0.6))
    axis.set_xlabel("of 100 data sets (line: level; dashed: asked for at most)")
    axis.set_xlim(0.0, min(100.0, max(10.0, axis.get_xlim()[1])))


def _fates(axis: Axes, summary: dict[str, Any]) -> None:
    rows = [
        (f"{what}, d' = {d}", summary[part][d]["all"])
        for part, what in (("unknown", "in no list"), ("removed", "taken out of the list"))
        for d in sorted(summary[part], key=float)
    ]
    left = np.zeros(len(rows))
    for verdict, colour in _COLOURS.items():
        width = np.array([100.0 * one[verdict]["rate"] for _, one in rows])
        axis.barh([name for name, _ in rows], width, left=left, color=colour, label=_WORDS[verdict], height=0.6)
        left += width
    axis.invert_yaxis()
    axis.set(title="Effects without a name", xlabel="of 100 data sets", xlim=(0.0, 100.0))
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=9)


def _without_data(summary: dict[str, Any]) -> list[str]:
    """How many data sets are in no rate, and why."""
    lines, count = [], summary.get("no such data", 0)
    if count:
        lines += [
            f"{count} more count in no rate: in their tissue no strength has the wanted d', or only one of more than "
            f"{MOST_IMPLAUSIBLE:g} times what is plausible.",
            "",
        ]
    unseen = summary["not testable"]
    if unseen["sets"]:
        lines += [
            f"In {unseen['sets']} of {unseen['of']} data sets with a known cause ({', '.join(unseen['names'])}) the "
            "diagnosis lists the hidden cause as one that these data cannot show. For it that is an effect in no list: "
            f"these sets are in none of the rates of known causes; given other names: {unseen['given other names']}.",
            "",
        ]
    return lines


def page(summary: dict[str, Any], study: Study) -> str:
    """The page."""
    return "\n".join(
        [
            f"# {study.title}",
            "",
            f"Made by `{study.command}` from {summary['data sets']} data sets {study.data}({summary['seeds']} "
            f"seeds): {study.design}. d' is the length of the effect after everything that the fitted constants can "
            "imitate is taken off, in standard deviations of the noise. ± is one standard error. The limit is what the "
            "largest projection gives if noise and directions were known; the second one what the likelihood ratio "
            "gives to somebody who knows the directions, and of the noise only the family that it is from, as the "
            "diagnosis does. A cause is detected where the verdict is `named`, `confusable` or `unexplained`, and what "
            "is said of sets of causes, of what is ruled out, unexplained or wrongly named is of detected ones; a "
            "strength has an interval where its cause was put into the model.",
            "",
            *([summary["code"], ""] if summary.get("code") else []),
            f"![Power, attribution and false alarms]({study.picture})",
            "",
            *_asked(summary),
            *_known(summary, ""),
            *_known(summary.get("unequal", {"known": {}}), ", magnitude and phase of unequal noise"),
            *_nothing(summary, study.gated),
            *_strange(summary, study),
            *_left(summary, study),
            *_without_data(summary),
            "What these rates rest on, and their limits:",
            "",
            f"- A true cause is called `unexplained` {_BY_ODDS}. Causes that are not ruled "
            f"out at {100.0 * SET_LEVEL:g} % are reported then, too, as `possible`; with them a true cause is kept.",
            "- An effect in no list is named as a cause if that leaves little enough, and no correction of no name "
            "that is looked for describes it much better. A cause that resembles it takes much of it: of an effect at "
            "d' = 5 with a cosine of 0.7 to some cause, 3.6 are left.",
            *(f"- {remark}" for remark in study.remarks),
            "",
        ]
    )


_COUNTED = 5
"""Data sets below which a rate is no number, but what happened."""


def _words(one: Rate) -> str:
    if not one["sets"]:
        return "–"
    if one["sets"] < _COUNTED:
        return f"{round(one['rate'] * one['sets'])} of {one['sets']}"
    return f"{100.0 * one['rate']:.1f} ± {100.0 * one['error']:.1f}"


def _in_a_text(one: Rate) -> str:
    return f"{_words(one)} %" if one["sets"] >= _COUNTED else _words(one)


def _asked(summary: dict[str, Any]) -> list[str]:
    """Every number that was asked for, beside the measured one."""
    rows = [
        "| asked for | measured [%] | limit [%] | limit, noise unknown [%] | data sets | met |",
        "| --- | ---: | ---: | ---: | ---: | --- |",
    ]

    def add(what: str, one: Rate, bound: Bound, limits: Sequence[float | None] = (None, None)) -> None:
        known = " | ".join("" if limit is None else f"{100.0 * limit:.1f}" for limit in limits)
        verdict = "too few" if one["sets"] < bound.sets else "yes" if bound.met(100.0 * one["rate"]) else "no"
        if verdict != "too few" and bound.margin(100.0 * one["rate"]) < 100.0 * one["error"]:
            verdict += ", within its error"
        rows.append(f"| {what} | {_words(one)} | {known} | {one['sets']} | {verdict} |")

    for d, detected, first in (("4.5", 93.0, 92.0), ("6", 98.0, 97.0)):
        if d not in summary["all known"]:
            continue
        known = summary["all known"][d]
        limit = known["limit"]
        least = Bound(lower=min(detected, 100.0 * limit["detected"] - 3.0))
        both = [(limit[key], limit.get(f"{key}, noise unknown")) for key in ("detected", "first")]
        what = f"d' = {d}: detected, at least {detected:g}, or 3 below the limit"
        add(what, known["detected"], least, both[0])
        least = Bound(lower=min(first, 100.0 * limit["first"] - 3.0))
        what = f"d' = {d}: right cause first, at least {first:g}, or 3 below the limit"
        add(what, known["first"], least, both[1])
    if "4.5" in summary["all known"]:
        known = summary["all known"]["4.5"]
        what = "d' = 4.5: of those detected, right cause in the reported set, at least 99"
        add(what, known["in the set, if detected"], Bound(lower=99.0))
        what = "d' = 4.5: of those detected, right cause not ruled out, `unexplained` included, at least 99"
        add(what, known["possible, if detected"], Bound(lower=99.0))
        add("d' = 4.5: of those detected, unexplained, at most 5", known["unexplained, if detected"], Bound(upper=5.0))
        if known["covered"]["sets"]:
            add("d' = 4.5: strength in its 95 % interval, 92 to 98", known["covered"], Bound(92.0, 98.0))
    for noise, one in summary["null"].items():
        add(f"nothing hidden, {noise} noise: false alarms, at most 6", one["alarm"], Bound(upper=6.0))
    for part, what in (("unknown", "effect in no list"), ("removed", "cause taken out of the list")):
        for d, verdict, word, bound in (
            ("9", "unexplained", "unexplained, at least 90", Bound(lower=90.0)),
            ("9", "named", "wrongly named, at most 5", Bound(upper=5.0)),
            ("9", "any name", "wrongly named, sets of names included, at most 5", Bound(upper=5.0)),
            ("5", "named", "wrongly named, at most 10", Bound(upper=10.0)),
            ("5", "any name", "wrongly named, sets of names included, at most 10", Bound(upper=10.0)),
        ):
            if d not in summary[part]:
                continue
            rests = summary[f"{part} limit"].get(d, {}).values()
            seen = [one for one in rests if "why" not in one]
            found = verdict == "unexplained" and seen
            limits = [float(np.mean([one[key] for one in seen])) if found else None for key in _KNOWN_OR_NOT]
            add(f"{what}, d' = {d}: {word}", summary[part][d]["all"][verdict], bound, limits)
    return ["## What was asked for", "", *rows, ""]


def _known(summary: dict[str, Any], ending: str) -> list[str]:
    lines = []
    for d in sorted(summary["known"], key=float):
        lines += [
            f"## Known causes, d' = {d}{ending}",
            "",
            "| hidden | detected (limit) | first (limit) | of those detected: not ruled out | unexplained "
            "| wrongly named | covered | causes possible | sets |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        ]
        for name, one in [*summary["known"][d].items(), ("**all**", summary["all known"][d])]:
            cells = [
                *(f"{_words(one[key])} ({_limit(one, key)})" for key in ("detected", "first")),
                _words(one["possible, if detected"]),
                _words(one["unexplained, if detected"]),
                _words(one["wrongly named, if detected"]),
                _words(one["covered"]),
                f"{one['causes in the set']:.1f}" if one["possible, if detected"]["sets"] else "–",
                f"{one['detected']['sets']}",
            ]
            lines.append(f"| {name} | {' | '.join(cells)} |")
        lines.append("")
    return lines


def _limit(one: dict[str, Any], key: str) -> str:
    return f"{100.0 * one['limit'][key]:.0f}" if "limit" in one else "–"


def _nothing(summary: dict[str, Any], gated: bool) -> list[str]:
    columns = ["false alarms", *(["`noise-model`"] if gated else []), "sets"]
    head = [f"| noise | {' | '.join(columns)} |", f"| --- |{' ---: |' * len(columns)}"]
    for noise, one in summary["null"].items():
        cells = [_words(one["alarm"]), *([_words(one["noise-model"])] if gated else []), f"{one['alarm']['sets']}"]
        head.append(f"| {noise} | {' | '.join(cells)} |")
    return ["## Nothing hidden", "", *head, ""]


def _strange(summary: dict[str, Any], study: Study) -> list[str]:
    lines = []
    for part, title in (("unknown", "Effects in no list"), ("removed", "True causes taken out of the list")):
        lines += [
            f"## {title}",
            "",
            "| d' | hidden | unexplained | named | in a set of names | not found | sets |",
            "| ---: | --- | ---: | ---: | ---: | ---: | ---: |",
        ]
        for d in sorted(summary[part], key=float):
            for kind, one in summary[part][d].items():
                cells = [_words(one[v]) for v in ("unexplained", "named", "confusable", "not found")]
                sets = one["named"]["sets"]
                lines.append(f"| {d} | {study.kinds.get(kind, kind)} | {' | '.join(cells)} | {sets} |")
        lines.append("")
    return lines


def _left(summary: dict[str, Any], study: Study) -> list[str]:
    """What stand-ins leave of effects without a name, and what became of those of which that is enough."""
    rows = [
        f"| {d} | {study.kinds.get(name, name)} | {one['why']} | – | – | – |"
        if "why" in one
        else f"| {d} | {study.kinds.get(name, name)} | {one['stand-in']} | {one['left']:.1f} "
        f"| {100.0 * one['noise known']:.0f} | {100.0 * one['noise unknown']:.0f} |"
        for limit in (summary["unknown limit"], summary["removed limit"])
        for d in sorted(limit, key=float)
        for name, one in limit[d].items()
    ]
    seen = summary["removed, to be seen"]
    enough = "; ".join(
        f"d' = {d}: unexplained {_in_a_text(seen[d]['unexplained'])}, named {_in_a_text(seen[d]['named'])}, in a set "
        f"of names {_in_a_text(seen[d]['confusable'])} ({seen[d]['named']['sets']} sets)"
        for d in sorted(seen, key=float)
    )
    said = (
        f"Causes taken out of which who looks for the rest sees it in at least {100.0 * SEEN:g} of 100, the noise "
        "unknown: "
    )
    return (
        [
            "## What is left to see of effects without a name",
            "",
            f"{study.rests} The powers are those of somebody who looks for exactly that rest, at a level of "
            f"{100.0 * UNEXPLAINED_LEVEL:g} % (as many true causes may be called `unexplained`), with the noise known "
            "and unknown: a diagnosis looks for everything, and does not reach them. (It may find the whole effect "
            "unlike any cause where the rest by itself is not conspicuous.) Where little is left, the stand-in "
            "describes the data, and its name is all that they allow.",
            "",
            "| d' | hidden | best stand-in | d' left | seen, noise known [%] | seen, noise unknown [%] |",
            "| ---: | --- | --- | ---: | ---: | ---: |",
            *rows,
            "",
            *([f"{said}{enough}.", ""] if enough else []),
        ]
        if rows
        else []
    )
