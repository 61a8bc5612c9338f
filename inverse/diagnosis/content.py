"""A diagnosis as diagnosis.json holds it."""

from collections.abc import Sequence
from typing import Any

from inverse.diagnosis.diagnosis import CauseReport, Diagnosis
from inverse.diagnosis.report import constants_of, links_of, once, unexplained
from inverse.diagnosis.where import Absorbed
from inverse.output import finite
from inverse.software import versions

SCHEMA_VERSION = 9
"""Of diagnosis.json; keys do not change without a new number."""


def as_json(found: Diagnosis, remarks: Sequence[str] = ()) -> dict[str, Any]:
    """What diagnosis.json holds, remarks on the file among its notes; numbers that are not finite become null."""
    omnibus = found.decision.omnibus if found.decision is not None else None
    content = {
        "schema_version": SCHEMA_VERSION,
        "verdict": found.verdict,
        "level": found.level,
        "omnibus": {
            "statistic": omnibus.statistic if omnibus else None,
            "p_value": omnibus.p_value if omnibus else None,
            "odds_of_no_name": vars(found.decision.odds) if found.decision is not None else None,
        },
        "causes": [_cause(one) for one in found.causes],
        "named": list(found.named),
        "confusable": [list(names) for names in found.confusable],
        "explanations": [list(names) for names in found.decision.explanations] if found.decision is not None else [],
        "not_testable": [
            {"name": one.name, "why": one.why, "what_would_help": one.what_would_help} for one in found.not_testable
        ],
        "gain": None if found.gain is None else vars(found.gain),
        "constants": [vars(one) for one in constants_of(found)],
        "noise": None if found.noise is None else {**vars(found.noise), "words": found.noise.describe()},
        "where": [_absorbed(one) for one in once(found.places)],
        "links": [_absorbed(one) for one in links_of(found)],
        "whiteness": [vars(one) for one in found.residuals_whiteness],
        "unexplained": unexplained(found),
        "audit": list(found.audit),
        "notes": [*remarks, *found.account.notes],
        "model": found.account.model,
        "seed": found.seed,
        "versions": versions(),
    }
    return finite(content)


def _absorbed(one: Absorbed) -> dict[str, Any]:
    return {"words": one.words, "share": one.share, "p_value": one.p_family}


def _cause(one: CauseReport) -> dict[str, Any]:
    return {
        "name": one.cause.name,
        "place": one.cause.place,
        "p_value": one.p_value,
        "p_value_alone": one.p_alone,
        "statistic": one.statistic,
        "estimate": one.estimate,
        "interval": list(one.interval),
        "unit": one.cause.unit,
        "shape": one.shape,
        "shape_means": one.cause.shape_means,
        "detectability": one.detectability,
        "status": one.status,
        "p_value_of_the_rest": one.left,
        "converged": one.converged,
        "physics": one.cause.sentence,
        "source": one.cause.source,
    }
