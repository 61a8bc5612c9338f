"""Tables and report of `arfjax infer`."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inverse.fast_hmi import Verification
from inverse.inference.profile import Profile, Stop
from inverse.output import quantity
from inverse.sampling import Evidence
from inverse.study import Study

FAST_ACCURACY = 5e-3
"""Error of the fast model's curves over their largest value that it is meant to keep."""

_DOUBTFUL = " ?"
"""Beside an interval that may be too narrow, as a warning says."""

_COLUMNS = (
    "parameter unit estimate standard_error profile_lower profile_upper profile_level profile_ends profile_converged "
    "posterior_mean posterior_sd posterior_5_percent posterior_median posterior_95_percent r_hat bulk_ess tail_ess "
    "prior prior_source"
).split()


def write_parameters(path: Path, study: Study) -> None:
    """One row a value: fit, profile, posterior, prior; empty where there is none."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for row in _rows(study):
            writer.writerow([_cell(row.get(name)) for name in _COLUMNS])


def parameter_rows(study: Study) -> tuple[tuple[str, ...], list[list[str]]]:
    """Header and rows of the table on the terminal."""
    levels = {f"{100.0 * one.level:g}" for one in study.profiles}
    profile = f"profile, {levels.pop()} %" if len(levels) == 1 else "profile"
    header = ("parameter", "unit", "fit", "±", profile, "posterior", "±", "5 to 95 %", "R-hat")
    return header, [
        [
            str(row["parameter"]),
            str(row["unit"]),
            _number(row["estimate"]),
            _number(row["standard_error"], 2),
            row.get("profile_said", "") + _DOUBTFUL * (row.get("profile_converged") is False),
            _number(row.get("posterior_mean")),
            _number(row.get("posterior_sd"), 2),
            _range(row.get("posterior_5_percent"), row.get("posterior_95_percent")),
            "" if row.get("r_hat") is None or math.isnan(row["r_hat"]) else f"{row['r_hat']:.3f}",
        ]
        for row in _rows(study)
    ]


def results(study: Study, checked: Verification | None, remark: str = "") -> dict[str, Any]:
    """What summary.json holds of the results."""
    found: dict[str, Any] = {
        "parameters": {
            str(row["parameter"]): quantity(row["estimate"], str(row["unit"]), row["standard_error"])
            for row in _rows(study)
        },
        "warnings": [*study.warnings, *([remark] if remark else [])],
    }
    found["fit"] = {
        "converged": study.fit.converged,
        "status": study.fit.status,
        "method": study.fit.method.value,
        "cost": quantity(study.fit.cost, "nats"),
        "condition_number": study.audit.identification.condition_number,
        "correlation": np.round(study.fit.uncertainty.correlation, 4).tolist(),
        "audit": [{"kind": each.kind.value, "sentence": each.sentence} for each in study.audit.findings],
    }
    if study.draws is not None and study.diagnostics is not None:
        found["posterior"] = {
            "sampler": study.draws.sampler,
            "stopping_rule_met": study.draws.finished,
            "message": study.draws.message,
            "draws": study.draws.n_chains * study.draws.n_draws,
            "seconds": study.draws.seconds,
            "complaints": list(study.diagnostics.complaints),
        }
    if study.evidence is not None:
        found["log_evidence"] = {
            **quantity(study.evidence.log_evidence, "nats", study.evidence.standard_error),
            "converged": study.evidence.converged,
        }
    if checked is not None:
        found["fast_model"] = {"models": len(checked.covered), "largest_error": checked.largest_error}
    return found


def report(
    study: Study,
    inputs: Sequence[Path],
    sweeps: Sequence[str],
    figures: Sequence[str],
    checked: Verification | None,
    remark: str = "",
) -> str:
    """The report, as Markdown; `sweeps` are used, `remark` is what must be known of data and fast model."""
    header, rows = parameter_rows(study)
    lines = [f"# Inference from {' and '.join(path.name for path in inputs)}", ""]
    lines += [f"Sweeps: {'; '.join(sweeps)}.", ""] if sweeps else []
    lines += [*_table(header, rows), "", *_fit_lines(study)]
    lines += _posterior_lines(study, checked, remark)
    lines += ["## What was believed before", "", *_table(("parameter", "prior", "source"), _beliefs(study)), ""]
    return "\n".join([*lines, *(f"![{name}]({name})" for name in figures), ""])


def _fit_lines(study: Study) -> list[str]:
    lines = [f"Fit by {study.fit.method.value}: {study.fit.status}.", "", "## What the fit can be trusted with", ""]
    lines += [f"- {each.sentence}" for each in study.audit.findings] or ["Nothing was found wrong with it."]
    if study.profiles and study.problem.parameters.has_priors:
        lines.append("- In profiles priors count as they do in the fit: an interval may be the prior's own.")
    lines += [f"- {one.name}, profile: {side}." for one in study.profiles for side in _open_ends(one)]
    condition = study.audit.identification.condition_number
    told = f"{condition:.3g}" if math.isfinite(condition) else "infinite, for what is not determined"
    return [*lines, "", f"Condition number of the Fisher information: {told}.", ""]


def _posterior_lines(study: Study, checked: Verification | None, remark: str) -> list[str]:
    if study.draws is None or study.diagnostics is None:
        return [remark, ""] if remark else []
    lines = ["## Posterior", "", f"{study.draws.sampler}, seed {study.draws.seed}: {study.draws.message}.", ""]
    if study.laplace is not None and not study.laplace.is_sound:
        lines.append(f"- Normal approximation: {study.laplace.message}.")
    lines += [f"- {each}" for each in study.diagnostics.complaints]
    if study.evidence is not None:
        lines += [f"- {evidence_line(study.evidence)}"]
        lines += [f"- {each}" for each in study.evidence.warnings]
    lines += [f"- {remark}"] if remark else []
    if checked is not None:
        lines += [
            f"- {len(checked.covered)} draws computed again by the full model: the curves differ by "
            f"{100.0 * checked.largest_error:.2g} % of their largest value at most{_judged(checked)}."
        ]
    return [*lines, "", *_table(study.diagnostics.columns, study.diagnostics.table), ""]


def evidence_line(evidence: Evidence) -> str:
    """The logarithm of the evidence, in words."""
    return f"log evidence {evidence.log_evidence:.3f} ± {evidence.standard_error:.2g} nats"


def _judged(checked: Verification) -> str:
    if checked.largest_error <= FAST_ACCURACY:
        return ""
    return f", more than the {100.0 * FAST_ACCURACY:g} % that it is meant to keep: count it as noise, or narrow priors"


def _open_ends(profile: Profile) -> list[str]:
    sides = zip(("lower", "upper"), profile.ends, strict=True)
    return [f"the {name} side {said}" for name, said in sides if said != Stop.CROSSED.value]


def _interval(profile: Profile) -> str:
    """Its ends, with none where neither data nor prior set a limit."""
    (low, high), (below, above) = profile.interval, (stop is Stop.CROSSED for stop in profile.stops)
    if below and above:
        return f"{low:.3g} to {high:.3g}"
    return f"> {low:.3g}" if below else f"< {high:.3g}" if above else "open"


def _beliefs(study: Study) -> list[list[str]]:
    parameters = study.problem.parameters
    return [[name, prior, source] for name, (prior, source) in zip(parameters.names, parameters.beliefs, strict=True)]


def _rows(study: Study) -> list[dict[str, Any]]:
    profiles = {one.name: one for one in study.profiles}
    drawn = {} if study.diagnostics is None else {row.name: row for row in study.diagnostics.rows}
    rows = []
    for (name, unit, _), value, error, belief in zip(
        study.problem.parameters.columns,
        *study.estimates,
        study.problem.parameters.beliefs,
        strict=True,
    ):
        row: dict[str, Any] = {
            "parameter": name,
            "unit": unit,
            "estimate": float(value),
            "standard_error": float(error),
            "prior": belief[0],
            "prior_source": belief[1],
        }
        if name in profiles:
            one = profiles[name]
            row |= {"profile_lower": one.interval[0], "profile_upper": one.interval[1], "profile_level": one.level}
            row["profile_ends"] = "; ".join(one.ends)
            row["profile_said"] = _interval(one)
            row["profile_converged"] = one.converged
        if name in drawn:
            found = drawn[name]
            row |= {
                "posterior_mean": found.mean,
                "posterior_sd": found.sd,
                "posterior_5_percent": found.lower,
                "posterior_median": found.median,
                "posterior_95_percent": found.upper,
                "r_hat": found.r_hat,
                "bulk_ess": found.bulk_size,
                "tail_ess": found.tail_size,
            }
        rows.append(row)
    return rows


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "| " + " | ".join(header) + " |",
        "| " + " | ".join("---" for _ in header) + " |",
        *("| " + " | ".join(row) + " |" for row in rows),
    ]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.6g}"
    return str(value)


def _number(value: float | None, digits: int = 4) -> str:
    return "" if value is None else f"{value:.{digits}g}" if math.isfinite(value) else "?"


def _range(low: float | None, high: float | None) -> str:
    return "" if low is None or high is None else f"{low:.3g} to {high:.3g}"
