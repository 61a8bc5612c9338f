"""What is wrong with an experiment file, in one line."""

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

import pydantic
from pydantic import BaseModel

EXAMPLE = "examples/suomi2016.toml"


def explain(error: pydantic.ValidationError, schema: type[BaseModel]) -> str:
    """What a validation found wrong first, in one line; an unknown key, often a misspelt one, before a missing one."""
    found = error.errors()
    first = next((each for each in found if each["type"] == "extra_forbidden"), found[0])
    where, kind = first["loc"], first["type"]
    if kind == "extra_forbidden":
        return f"unknown key {_place(where)}; {_advice(where, schema)}"
    if kind == "missing" and isinstance(where[-1], str):
        return f"missing key {_place(where)}; add it ({EXAMPLE} shows all)."
    place = f"{_place(where)}: " if where else ""
    return f"{place}{_wording(first).rstrip('.')}."


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text in quotation marks",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "missing": "one value more",
}
"""What was expected, by pydantic's name of the mistake."""


def _wording(mistake: Mapping[str, Any]) -> str:
    kind, given = mistake["type"], _shown(mistake["input"])
    if kind in ("value_error", "assertion_error"):
        return mistake["msg"].partition(", ")[2]
    if kind == "literal_error":
        return f"expected {mistake['ctx']['expected']}, got {given}"
    if kind == "too_short":
        return f"expected at least {mistake['ctx']['min_length']} values, got {given}"
    if kind == "too_long":
        return f"expected at most {mistake['ctx']['max_length']} values, got {given}"
    if kind in _EXPECTED:
        return f"expected {_EXPECTED[kind]}, got {given}"
    return f"{mistake['msg'].replace('Input should', 'the value must')}, got {given}"


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python does not print integers of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:60]}..."


def _dotted(where: tuple[int | str, ...]) -> str:
    return ".".join(part for part in where if isinstance(part, str))


def _place(where: tuple[int | str, ...]) -> str:
    """A key, and which entry of its list, counted from one."""
    entries = [str(part + 1) for part in where if isinstance(part, int)]
    return f"`{_dotted(where)}`" + (f" (entry {'.'.join(entries)})" if entries else "")


def _advice(where: tuple[int | str, ...], schema: type[BaseModel]) -> str:
    """The known key that is nearest to an unknown one, in its own section if there is one."""
    section, name = _dotted(where[:-1]), str(where[-1])
    known = list(_known_keys(schema))
    siblings = [key for key in known if key.rpartition(".")[0] == section]
    for keys in (siblings, known):
        near = difflib.get_close_matches(name, [key.rpartition(".")[2] for key in keys], n=1)
        if near:
            return f"did you mean `{next(key for key in keys if key.rpartition('.')[2] == near[0])}`?"
    return f"remove it; known here are {', '.join(key.rpartition('.')[2] for key in siblings)}."


def _known_keys(schema: type[BaseModel], section: str = "") -> Iterator[str]:
    for name, field in schema.model_fields.items():
        yield section + name
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                yield from _known_keys(candidate, f"{section}{name}.")
