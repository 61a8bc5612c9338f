"""What a design says: which causes are alive, what each further measurement would tell of them, and the proof."""

import dataclasses
from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from arfjax import InputError
from inverse.design.dma_information import Information
from inverse.design.separation import Separation
from inverse.diagnosis.cause import AnyCause, Extension
from inverse.diagnosis.choice import find_causes
from inverse.diagnosis.diagnosis import CauseReport, Diagnosis
from inverse.diagnosis.examination import require_seen


@runtime_checkable
class Proposal(Protocol):
    """Further readings that one could take."""

    @property
    def name(self) -> str:
        """Short."""
        ...

    @property
    def words(self) -> str:
        """What to do."""
        ...

    @property
    def seconds(self) -> float | None:
        """How long it takes [s]."""
        ...

    @property
    def keys(self) -> dict[str, float | str]:
        """What `[protocol]` of an experiment file says of it; nothing where there is none."""
        ...

    def __len__(self) -> int:
        """Number of readings."""
        ...


@dataclasses.dataclass(frozen=True)
class Rated:
    """A proposal and what it would tell.

    Attributes:
        proposal: What to do.
        separation: Of the causes, by the data that there are and those of the proposal together.
    """

    proposal: Proposal
    separation: Separation


@dataclasses.dataclass(frozen=True)
class Check:
    """The best proposal simulated with each cause in turn, and diagnosed again.

    Attributes:
        hidden: Cause that was put in.
        verdict: Of the diagnosis.
        named: Causes that it named.
        confusable: Causes that it cannot tell apart.
    """

    hidden: str
    verdict: str
    named: tuple[str, ...]
    confusable: tuple[str, ...]


def checked(hidden: str, again: Diagnosis) -> Check:
    """What a diagnosis says of a simulation with a cause in it."""
    return Check(hidden, again.verdict, again.named, tuple(name for names in again.confusable for name in names))


@dataclasses.dataclass(frozen=True)
class Design:
    """What to measure next.

    Attributes:
        verdict: Of the diagnosis of the data that there are.
        causes: That are to be told apart, with the strengths that the data give them.
        now: What the data tell that there are.
        rated: Proposals, the best first; none where none could be rated.
        checks: Of the best one, by simulation; empty if not asked for.
        sizes: Standard deviation of the noise that was assumed, relative: of displacement or magnitude, then of the
            phase [rad], if there is one.
        seed: Of random orders and simulations.
        notes: Why these causes, where the diagnosis does not ask for them; what was left out, and why.
        information: Where a single further reading of a DMA would tell most; None if not asked for, and for curves.
    """

    verdict: str
    causes: dict[str, float]
    now: Separation
    rated: tuple[Rated, ...]
    checks: tuple[Check, ...]
    sizes: tuple[float, ...]
    seed: int
    notes: tuple[str, ...] = ()
    information: Information | None = None


def alive(
    found: Diagnosis, wanted: Sequence[str], library: Sequence[AnyCause]
) -> tuple[list[Extension[AnyCause]], Float[np.ndarray, " cause"]]:
    """Causes to tell apart, in the shapes and strengths that the data give them.

    Args:
        found: The diagnosis.
        wanted: Names, each once; those that the diagnosis leaves possible, or the two likeliest, if empty.
        library: Causes.

    Raises:
        InputError: if there are no two causes to tell apart, if what is to be told apart are sets of two at once, or if
            the fit failed.
    """
    if found.noise is None:
        raise InputError("the fit of these data failed, so that there is nothing to design by: see `arfjax diagnose`.")
    explanations = () if found.decision is None else found.decision.explanations
    together = "; ".join(" with ".join(names) for names in explanations if len(names) > 1)
    if together and not wanted:
        raise InputError(
            f"the answer to these data is two causes at once ({together}), and what would separate sets of two "
            "is not rated: name causes to tell apart (--causes)."
        )
    known = {one.cause.name: one for one in found.causes}
    wanted = [cause.name for cause in find_causes(wanted, library)]
    require_seen(wanted, list(known), found.not_testable)
    names = list(wanted) or _in_question(found)
    if len(names) < 2:
        names = list(dict.fromkeys([*names, *known]))[:2]
    if len(names) < 2:
        raise InputError("a design tells causes apart: these data see fewer than two.")
    reports = [known[name] for name in names]
    by_name = {cause.name: cause for cause in library}
    extensions = [Extension(by_name[one.cause.name], 0.0 if one.shape is None else one.shape) for one in reports]
    # What would be found is no smaller than what can be, and none that there cannot be.
    strengths = np.array([max(abs(one.estimate), one.detectability) * _sign(one) for one in reports])
    strengths = np.clip(strengths, *np.array([one.cause.possible for one in reports]).T)
    return extensions, strengths


def _in_question(found: Diagnosis) -> list[str]:
    return [one.cause.name for one in found.causes if one.status in ("named", "confusable", "possible")]


def reasons(found: Diagnosis, wanted: Sequence[str], taken: Sequence[str]) -> tuple[str, ...]:
    """Why these causes, where neither somebody nor the diagnosis asked for two of them.

    Args:
        found: The diagnosis.
        wanted: Names that were asked for.
        taken: Names that `alive` gave.
    """
    left, listed = _in_question(found), " and ".join(taken)
    if len(set(wanted)) > 1 or (not wanted and len(left) > 1):
        return ()
    if wanted:
        return (
            f"Of {wanted[0]} alone nothing is to be told apart: {listed} were taken, the likeliest other beside it.",
        )
    if left:
        return (f"The diagnosis leaves {left[0]} alone: {listed} were taken, the likeliest other beside it.",)
    return (
        f"The diagnosis says `{found.verdict}` and leaves no cause in question: {listed}, its likeliest, were taken.",
    )


def _sign(report: CauseReport) -> float:
    return 1.0 if report.cause.sign > 0 or report.estimate >= 0.0 else -1.0
