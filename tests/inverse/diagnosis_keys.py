"""Keys of diagnosis.json and design.json, written out once more: one more or less is another version of the schema."""

KEYS = (
    "schema_version verdict level omnibus causes named confusable explanations not_testable gain constants noise where "
    "links whiteness unexplained audit notes model seed versions separation"
).split()
SCHEMA_VERSION = 9

INSIDE = {
    "omnibus": "statistic p_value odds_of_no_name".split(),
    "causes": (
        "name place p_value p_value_alone statistic estimate interval unit shape shape_means detectability status "
        "p_value_of_the_rest converged physics source"
    ).split(),
    "not_testable": "name why what_would_help".split(),
    "gain": (
        "split rmse_before rmse_before_error rmse_after rmse_after_error log_score_gain standard_error unfinished"
    ).split(),
    "constants": "name unit of without with_causes without_at_end with_causes_at_end".split(),
    "noise": (
        "kind p_white size p_size sizes p_sizes weighed excess_kurtosis p_tails repeats repeats_freedom p_repeats words"
    ).split(),
    "where": "words share p_value".split(),
    "links": "words share p_value".split(),
    "whiteness": "along correlation p_value".split(),
    "separation": "causes angle_deg probability_right measurement".split(),
}
"""Keys of the parts: of each of them, where they are lists."""

MEASUREMENT = "name words readings seconds angle_deg probability_right".split()
"""Of the measurement that would separate causes best, in `separation`."""

DESIGN_KEYS = "schema_version verdict causes now proposals reading notes checks noise seed versions".split()
DESIGN_VERSION = 4
_APART = "probability_right angle_deg d_prime cosine".split()
INSIDE_DESIGN = {
    "now": _APART,
    "proposals": ["name", "words", "readings", "seconds", "protocol", *_APART],
    "reading": "causes temperature_c frequency_hz information_nat".split(),
    "checks": "hidden verdict named confusable".split(),
}


def require_keys(content):
    """Keys of diagnosis.json, all of them and no others, whatever is empty."""
    assert set(content) == set(KEYS) and content["schema_version"] == SCHEMA_VERSION
    _require_inside(content, INSIDE)
    _require_inside(
        {"measurement": [one["measurement"] for one in content["separation"]]}, {"measurement": MEASUREMENT}
    )


def require_design_keys(content):
    """Keys of design.json, all of them and no others, whatever is empty."""
    assert set(content) == set(DESIGN_KEYS) and content["schema_version"] == DESIGN_VERSION
    _require_inside(content, INSIDE_DESIGN)


def _require_inside(content, inside):
    for part, keys in inside.items():
        of_part = content[part] if isinstance(content[part], list) else [content[part]]
        assert all(set(one) == set(keys) for one in of_part if one is not None), part
