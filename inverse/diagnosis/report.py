"""A diagnosis in words."""

import math
from collections.abc import Sequence

from inverse.diagnosis.constants import FittedConstant, as_table
from inverse.diagnosis.decision import REPLICATES, Decision
from inverse.diagnosis.diagnosis import CauseReport, Diagnosis
from inverse.diagnosis.evidence import ALLOWANCE, Evidence
from inverse.diagnosis.examination import MOST_IMPLAUSIBLE
from inverse.diagnosis.noise_gate import GATE_LEVEL, REPLICATES_OF_SIZES, NoiseGate
from inverse.diagnosis.rule import MOST_BESIDE, MOST_INSTEAD, SET_LEVEL, UNEXPLAINED_LEVEL
from inverse.diagnosis.where import LEAST_OF_WHITENESS, Absorbed

_VERDICTS = {
    "adequate": "Nothing is wrong that these data could show.",
    "named": "The model lacks one cause, if what it lacks is among those that were looked for.",
    "two": "The model lacks two causes, if what it lacks is among those that were looked for.",
    "confusable": "The model lacks something, and these data cannot tell which of several causes it is.",
    "unexplained": "The model is wrong, and no named cause explains well enough how.",
    "noise-model": "The model is adequate, but the noise is not what one would take it for.",
    "fit-failure": "The fit itself failed; nothing is said about physics.",
}


_PLACES = 5
_NO_SCATTER = 1e-6
"""Of the noise; repeats that scatter by less were not measured twice."""


def once(places: Sequence[Absorbed]) -> list[Absorbed]:
    """The least likely to be noise, those first that absorb most; of a coarse and a fine form of the same words one."""
    found: dict[str, Absorbed] = {}
    for one in places:
        found.setdefault(one.words, one)
    return sorted(list(found.values())[:_PLACES], key=lambda one: -one.share)


def unexplained(found: Diagnosis) -> str | None:
    """The free-form correction in words, where structure remains."""
    if found.verdict != "unexplained" or not found.places:
        return None
    return found.account.describe(found.places[0])


def _sentence(found: Diagnosis) -> str:
    if found.verdict == "unexplained" and found.named:
        return "The model is wrong: one named cause explains most of it, and what is left has no name."
    return _VERDICTS["two" if found.verdict == "named" and len(found.named) > 1 else found.verdict]


def report(
    found: Diagnosis, name: str, figures: Sequence[str], *, apart: Sequence[str] = (), remarks: Sequence[str] = ()
) -> str:
    """The report in Markdown.

    Args:
        found: What is reported.
        name: Of the data.
        figures: Names of their files.
        apart: How causes that these data cannot tell apart could be, in sentences.
        remarks: On the file.
    """
    lines = [f"# Diagnosis of {name}", "", f"**{found.verdict}.** {_sentence(found)}", ""]
    if found.decision is not None:
        omnibus = found.decision.omnibus
        lines += [
            f"That noise alone looks as bad: p {_p(omnibus.p_value, omnibus.least_p, '= ')} (level {found.level:g}, "
            f"calibrated on {_replicates(omnibus)} replicates of these residuals{_allowance(omnibus)})."
            f"{_by_chance(omnibus, found.level)} Null model: {found.account.sentence}.",
            "",
        ]
    lines += [f"- {note}" for note in (*remarks, *found.account.notes)]
    lines += ["", *found.account.facts(found.in_question), *(f"![{figure}]({figure})" for figure in figures), ""]
    # Before any physics is blamed: whether the fit is sound, and the noise what one would take it for.
    if found.audit:
        lines += ["## What the fits say about themselves", "", *(f"- {remark}" for remark in found.audit), ""]
    lines += _noise(found) + _named(found, apart) + _table(found) + _where(found) + _hidden(found)
    return "\n".join(lines)


def _replicates(tested: Evidence) -> int:
    """How many were drawn."""
    return round(tested.allowance / tested.least_p) - 1


def _by_chance(tested: Evidence, level: float) -> str:
    """That replicates of another seed may put the p-value on the other side of the level, where they may."""
    share = tested.p_value / tested.allowance
    scatter = tested.allowance * math.sqrt(share * (1.0 - share) / (1 + _replicates(tested)))
    if abs(tested.p_value - level) > 2.0 * scatter:
        return ""
    return (
        f" (By replicates alone p scatters by {scatter:.1g}: other seeds may find it on the other side of the level.)"
    )


def _allowance(tested: Evidence) -> str:
    """What is to be said of p-values that hold whatever the noise is."""
    if tested.allowance == 1.0:
        return ""
    return (
        f" in every kind of noise that they may have, and multiplied by {tested.allowance:g}, as p of causes is: so "
        "few readings say little of their noise"
    )


def _named(found: Diagnosis, apart: Sequence[str]) -> list[str]:
    lines: list[str] = []
    members = set(found.named) | {name for names in found.confusable for name in names}
    for one in found.causes:
        if one.cause.name in members:
            lines += [f"- **{one.cause.name}** ({one.cause.place}): {one.cause.sentence} {_strength(one)}"]
            if one.status == "confusable":
                lines += [f"  To tell it from the others: {one.cause.helps}"]
    lines += ["", *apart, ""] if apart else []
    together = pairs_in_question(found)
    if together:
        lines += [
            "",
            f"No cause alone is the answer; two together are: {'; '.join(together)}. What would separate sets of two "
            "is not rated.",
            "",
        ]
    lines += _beyond_causes(found)
    text = unexplained(found)
    if text:
        # A paragraph of its own: the line before it may be of a list.
        lines += ["", f"What is left, without a name: {text}."]
    if found.gain is not None and found.extended is not None:
        names = " and ".join(_put_in(found))
        gain = found.gain
        course = "rises" if gain.log_score_gain > 0.0 else "falls"
        lines += [
            "",
            f"With {names} in the model, differences from data that were left out ({gain.split}) go "
            f"from {_percent(gain.rmse_before, gain.rmse_before_error)} to "
            f"{_percent(gain.rmse_after, gain.rmse_after_error)} % (root mean square); the log "
            f"score {course} by {abs(gain.log_score_gain):.3g} ± {gain.standard_error:.2g} nat a datum. A gain proves "
            f"no cause: wrong ones gain, too, in most cases. What is said of causes rests on the tests.",
            f"{gain.unfinished} of the refits did not converge." if gain.unfinished else "",
            "",
        ]
    if constants := constants_of(found):
        lines += [f"Constants without and with {' and '.join(_put_in(found))}:", "", *as_table(constants), ""]
    return ["## What is wrong", "", *lines, ""] if lines else []


def pairs_in_question(found: Diagnosis) -> list[str]:
    """Pairs of causes that each explain the data, in words; none where there is one, or where one cause is enough."""
    pairs = found.decision.explanations if found.decision is not None else ()
    return [" with ".join(names) for names in pairs] if len(pairs) > 1 and any(len(one) > 1 for one in pairs) else []


def _beyond_causes(found: Diagnosis) -> list[str]:
    """Why no cause is named, where that is not what each of them leaves."""
    decision = found.decision
    if decision is None or found.verdict != "unexplained":
        return []
    if not found.causes:
        return ["These data can see none of the causes that were looked for.", ""]
    if not decision.candidates:
        return ["None of the causes that were looked for is likely enough by itself to be put into the model.", ""]
    left = {one.cause.name: one.left for one in found.causes if one.converged and one.status == "possible"}
    near = [name for name, p_value in left.items() if p_value is not None and p_value >= UNEXPLAINED_LEVEL]
    said = _by_the_odds(decision)
    if said and near:
        who = near[0] if len(near) == 1 else f"Each of {', '.join(near)}"
        said += f" {who} would leave nothing conspicuous, and is not named for this reason."
    return [said, ""] if said else []


def _by_the_odds(decision: Decision) -> str:
    """What a correction of no name does better than a cause; nothing where the causes are ruled out by p-values."""
    odds = decision.odds
    if odds.instead > MOST_INSTEAD:
        return (
            "A correction of no name is too probable in the place of all causes: by its odds of "
            f"{odds.instead:+.2g} nat, strengths and noise averaged over, where {MOST_INSTEAD:+.2g} are allowed."
        )
    if odds.beside > MOST_BESIDE:
        return (
            f"{decision.best_fit} fits best, and a correction of no name is too probable beside it: by its odds of "
            f"{odds.beside:+.2g} nat, strengths and noise averaged over, where {MOST_BESIDE:+.2g} are allowed."
        )
    return ""


def _percent(value: float, error: float) -> str:
    return f"{100.0 * value:.3g} ± {100.0 * error:.2g}"


def constants_of(found: Diagnosis) -> list[FittedConstant]:
    """How the fitted constants move when the extension is in the model; none where nothing was put into it."""
    return [] if found.extended is None else found.account.constants(found.extended)


def _strength(one: CauseReport) -> str:
    shape = f", {one.cause.shape_means}: here {one.shape:.3g}" if one.shape is not None else ""
    unit = "" if one.cause.unit == "1" else f" {one.cause.unit}"
    beyond = abs(one.estimate) > MOST_IMPLAUSIBLE * one.cause.plausible
    far = f" That is more than {MOST_IMPLAUSIBLE:.0f} times what one would believe ({one.cause.plausible:.3g}{unit})."
    note = "" if one.converged else " (the refit did not converge)"
    curse = " Found just above the threshold, it is probably overestimated." if abs(one.statistic) < 4.5 else ""
    return (
        f"Strength {one.estimate:.3g}{unit} ({one.interval[0]:.3g} to {one.interval[1]:.3g} at 95 %){shape}"
        f"{note}.{curse}{far if beyond else ''}"
    )


def _table(found: Diagnosis) -> list[str]:
    if not found.causes:
        return []
    lines = [
        "## All causes that these data can see",
        "",
        "| cause | place | t | p | p alone | p of the rest | strength | 95 % | would be seen from | unit | status |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- | --- |",
    ]
    least = found.decision.omnibus.least_p if found.decision is not None else 0.0
    both = _put_in(found)
    lines += [
        f"| {one.cause.name} | {one.cause.place} | {one.statistic:.2f} | {_p(one.p_value, least)} | {one.p_alone:.2g} "
        f"| {_rest(found, one)} "
        f"| {one.estimate:.3g} | {one.interval[0]:.3g} to {one.interval[1]:.3g} | {one.detectability:.3g} "
        f"| {one.cause.unit} | {one.status}{'' if one.converged else ' (the refit did not converge)'} |"
        for one in found.causes
    ]
    return [
        *lines,
        "",
        "p is for the whole family of causes and free forms, p alone for this cause by itself, p of the rest for what "
        "the model with it leaves, where it was put in: where something is wrong the likeliest are, six at most; what "
        "was not is called not needed. A cause is ruled out if what it leaves is conspicuous, and possible if that is "
        f"unlikely (p below {UNEXPLAINED_LEVEL:g}) but not out of the question ({SET_LEVEL:g}), if its refit did not "
        "converge, or if it does not explain the data well enough, given how well a correction of no name does. "
        '"Would be seen from" is the strength of d\' = 4.5 in noise such as the model of the verdict leaves: found in '
        "96 of 100 such data sets if noise and model were known, in fewer as they are not. Intervals of what is named "
        "or possible end where the likelihood has fallen to the bound, all else fitted anew, unless the fits say "
        "otherwise of themselves; those of others are of the curvature, and can hold 0 in spite of a large t where a "
        "second parameter is free."
        + (f" Strengths of {' and '.join(both)} are of the model with both." if len(both) > 1 else ""),
        "",
    ]


def _put_in(found: Diagnosis) -> list[str]:
    """Causes in the model of the verdict."""
    return [extension.cause.name for extension in found.extended.extensions] if found.extended is not None else []


def _rest(found: Diagnosis, one: CauseReport) -> str:
    """P of what the model with a cause leaves, if it was put in."""
    if one.left is None or found.decision is None:
        return "–"
    return _p(one.left, found.decision.tests[one.cause.name].least_p)


def _p(value: float, least: float, equal: str = "") -> str:
    """A p-value, or that it is at most the least that the replicates can show."""
    return f"≤ {value:.2g}" if value <= 1.001 * least else f"{equal}{value:.3g}"


def _where(found: Diagnosis) -> list[str]:
    model = f"with {' and '.join(_put_in(found))} in it" if _put_in(found) else "without causes"
    lines = [
        "## Where",
        "",
        f"Of what the model {model} leaves, corrections of no name could take (what it leaves is the misfit here):",
        "",
        "| free correction | share of the misfit that it absorbs | p |",
        "| --- | ---: | ---: |",
    ]
    places = once(found.places)
    least = found.decision.last.least_p if found.decision is not None else 0.0
    lines += [f"| {one.words} | {100.0 * one.share:.0f} % | {_p(one.p_family, least)} |" for one in places]
    if places:
        lines += ["", f"Noise looks least like the one {found.places[0].words}."]
    lines += ["", "Residuals of the model without causes:", ""]
    lines += ["| neighbours along | correlation of residuals | p |", "| --- | ---: | ---: |"]
    lines += [
        f"| {one.along} | {one.correlation:+.2f} | {_p(one.p_value, LEAST_OF_WHITENESS)} |"
        for one in found.residuals_whiteness
    ]
    lines = [*lines, "", *_links(found)]
    return lines if found.places or found.residuals_whiteness else []


def _links(found: Diagnosis) -> list[str]:
    """In which link of a chain a smooth correction could take what no cause is in the model for."""
    links = links_of(found)
    if not links:
        return []
    least = ALLOWANCE / (1 + REPLICATES)
    return [
        "Before any cause is put in, a correction of no name in one link of the model, smooth along temperature, could "
        "take (p: that noise alone gives any of these as much). To take the most is no proof: links resemble "
        "one another.",
        "",
        "| link | share of the misfit that it could take | p |",
        "| --- | ---: | ---: |",
        *(f"| {one.words} | {100.0 * one.share:.0f} % | {_p(one.p_family, least)} |" for one in links),
        "",
    ]


def links_of(found: Diagnosis) -> tuple[Absorbed, ...]:
    """Of data of which something is wrong."""
    return found.account.links() if found.verdict in ("named", "confusable", "unexplained") else ()


def _noise(found: Diagnosis) -> list[str]:
    if found.noise is None:
        return []
    gate = found.noise
    unit = "times the stated deviations" if found.account.stated_deviations else "relative"
    unit += ", the geometric mean" if gate.weighed else ""
    lines = [
        f"{gate.describe()[0].upper()}{gate.describe()[1:]}; size {gate.size:.3g} ({unit}). White noise of one size "
        f"looks so with p = {gate.p_white:.2g}, Gaussian noise has such tails with p = {gate.p_tails:.2g} (each counts "
        f"below {GATE_LEVEL:g})."
    ]
    if gate.weighed:
        lines += [
            "Magnitude and phase weigh by sizes that were found in what constants and causes leave (white noise of one "
            f"size looks as unlike with p {_p(gate.p_sizes, 1.0 / (1 + REPLICATES_OF_SIZES), '= ')})."
        ]
    elif gate.p_sizes < GATE_LEVEL:
        lines += ["Standard deviations in the file would weigh each by its own size."]
    if gate.repeats_freedom:
        lines += [
            f"Repeated measurements scatter by {gate.repeats:.3g} ({gate.repeats_freedom} degrees of freedom); "
            + _lack_of_fit(gate)
        ]
    if not gate.as_thought:
        lines += [
            "The tests below do not need white noise: its size, its course and its tails were fitted to these data."
        ]
    return ["## The noise", "", *lines, ""]


def _lack_of_fit(gate: NoiseGate) -> str:
    """What the scatter of repeats says of the residuals, if anything."""
    if not math.isnan(gate.p_repeats):
        return f"that noise leaves residuals as large with p = {gate.p_repeats:.2g} (lack of fit)."
    if gate.repeats < _NO_SCATTER * gate.size:
        return "they are the same readings written again, and say nothing of the noise."
    return "beside the constants nothing is left that they could be compared with."


def _hidden(found: Diagnosis) -> list[str]:
    if not found.not_testable:
        return []
    lines = [f"- **{one.name}**: {one.why}. {one.what_would_help}" for one in found.not_testable]
    return ["## What these data cannot see", "", *lines, ""]
