"""Which causes of a library are looked for."""

from collections.abc import Sequence

from arfjax import InputError
from inverse.diagnosis.cause import AnyCause, Cause, DmaCause, require_causes
from inverse.diagnosis.hmi.cause import HmiCause


def find_causes(wanted: Sequence[str | Cause], library: Sequence[AnyCause]) -> tuple[AnyCause, ...]:
    """Causes by their names; those that are causes already stay as they are, each once.

    Args:
        wanted: Names and causes.
        library: Where names are looked up.

    Raises:
        InputError: if there is none of a name, or a cause is of another kind than the library's.
    """
    require_causes(library)
    known, found = {cause.name: cause for cause in library}, {}
    kind = DmaCause if isinstance(library[0], DmaCause) else HmiCause
    for one in wanted:
        if isinstance(one, str) and one not in known:
            raise InputError(f"causes: there is no cause '{one}'; there are {', '.join(known)}.")
        cause = known[one] if isinstance(one, str) else one
        if not isinstance(cause, kind):
            raise InputError(f"causes: '{cause.name}' is no {kind.__name__}: it belongs to another measurement.")
        found[cause.name] = cause
    return tuple(found.values())
