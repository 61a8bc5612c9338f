"""Which causes of a library are looked for."""

import difflib
import itertools
import math
from collections.abc import Sequence

from arfjax import InputError
from inverse.diagnosis.cause import AnyCause, Cause, require_causes
from inverse.diagnosis.dma.cause import DmaCause, makes_rows_of_others
from inverse.diagnosis.dma.causes import DMA_CAUSES
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.causes import HMI_CAUSES

_SAYS = ("name", "place", "unit", "sign", "plausible", "sentence", "helps", "source")
"""What a cause has to say of itself."""
LIBRARIES: dict[str, tuple[Cause, ...]] = {"dma": DMA_CAUSES, "hmi": HMI_CAUSES}
"""All causes of each measurement, which the commands name thus."""
_CALLED = {"dma": "a DMA", "hmi": "curves of displacement"}


def find_causes(wanted: Sequence[str | Cause], library: Sequence[AnyCause]) -> tuple[AnyCause, ...]:
    """Causes by their names; those that are causes already stay as they are, each once.

    Args:
        wanted: Names and causes.
        library: Where names are looked up.

    Raises:
        InputError: if there is none of a name, two different ones have the same, or something is no cause, lacks what a
            cause says of itself, says what fits cannot use, or is of another kind than the library's.
    """
    require_causes(library)
    known, found = {cause.name: cause for cause in library}, {}
    kind = DmaCause if isinstance(library[0], DmaCause) else HmiCause
    for one in wanted:
        if isinstance(one, str):
            require_known([one], list(known))
        of_library = any(one is other for other in library)
        cause = known[one] if isinstance(one, str) else one if of_library else _as_cause(one, kind)
        if found.setdefault(cause.name, cause) is not cause:
            raise InputError(f"causes: two are called '{cause.name}': give one of them another name.")
    return tuple(found.values())


def names_in(text: str) -> list[str]:
    """Names by commas, as the option `--causes` has them; none where it is left out.

    Args:
        text: As a user wrote it.

    Raises:
        InputError: if there is a text and no name in it.
    """
    names = [name.strip() for name in text.split(",") if name.strip()]
    if text and not names:
        raise InputError(f"--causes: names by commas are expected, got '{text}'; leave it out to look for all.")
    return names


def require_known(wanted: Sequence[str], known: Sequence[str]) -> None:
    """Refuse names of which there is no cause, and say which may be meant.

    Args:
        wanted: Names that a user wrote.
        known: All that there are of these data.

    Raises:
        InputError: for the first name that is not among them.
    """
    for name in wanted:
        if name in known:
            continue
        other = [_CALLED[kind] for kind, causes in LIBRARIES.items() if name in {cause.name for cause in causes}]
        if other:
            raise InputError(
                f"causes: '{name}' is a cause of {other[0]}, not of these data; of these there are {', '.join(known)}."
            )
        close = difflib.get_close_matches(name, known, n=1)
        meant = f" (is '{close[0]}' meant?)" if close else ""
        raise InputError(f"causes: there is no cause '{name}'{meant}; there are {', '.join(known)}.")


def _as_cause(one: object, kind: type[AnyCause]) -> AnyCause:
    """What a user gave in place of a name, if it is a cause of the kind."""
    if isinstance(one, type):
        raise InputError(f"causes: {one.__name__} is a class; give a cause of it: {one.__name__}().")
    if not isinstance(one, Cause):
        raise InputError(f"causes: {one!r} is no cause: give names, or causes as CONTRIBUTING.md shows.")
    missing = [word for word in _SAYS if not hasattr(one, word)]
    if missing:
        raise InputError(f"causes: {type(one).__name__} does not say its {', '.join(missing)}.")
    if not isinstance(one, kind):
        raise InputError(f"causes: '{one.name}' is no {kind.__name__}: it belongs to another measurement.")
    for wrong, expected in _wrong_in(one):
        if wrong:
            raise InputError(f"causes: '{one.name}' needs {expected}; `Cause` says what each of them is.")
    if isinstance(one, DmaCause) and not one.mixes_rows and makes_rows_of_others(one):
        raise InputError(
            f"causes: '{one.name}' makes a row's modulus of other rows': say `mixes_rows = True` in it, so that its "
            "derivatives are taken for that."
        )
    return one


def _wrong_in(one: Cause) -> tuple[tuple[bool, str], ...]:
    """What a cause says of itself that fits and searches could not use, and what is expected."""
    ascending = all(a < b for a, b in itertools.pairwise(one.shapes))
    return (
        (one.sign not in (0, 1), f"a `sign` of 0 (either sign) or 1 (none below 0), got {one.sign}"),
        (not 0.0 < one.plausible < math.inf, f"a finite `plausible` above 0, got {one.plausible:g}"),
        (not one.largest >= one.plausible, f"a `largest` of its `plausible`, {one.plausible:g}, or more"),
        (one.sign == 0 and not one.least < 0.0, f"a `least` below 0, since its `sign` is 0, got {one.least:g}"),
        (not (one.shapes and ascending), f"`shapes` that ascend, at least one, got {one.shapes}"),
        (len(one.shapes) > 1 and not one.shape_means, "a `shape_means`, since it has several `shapes`"),
    )
