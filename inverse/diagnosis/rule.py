"""What one cause has to explain, and what two: the odds of a correction of no name up to which they are enough.

Limits are chosen so that 5 of 100 true causes at most are called `unexplained`, whatever their size. Measured on linear
curves of development seeds, of 100: true causes of d' 4.5 and 6 4.4 and 4.7 (654 sets each), effects in no list of d' 9
89 (500), causes taken out 81 (510; one in ten is not found to begin with); of d' 5 39 and 44. By
p-values of what the best cause leaves, with the lead of corrections over causes at their best, which this replaces, 70
and 47 were of d' 9. On a dynamic mechanical analysis, refits in full: true causes 2.8 and 1.4 (72 each), effects in no
list 100 (53), causes taken out 84 (67; 64 before).

The larger an effect on curves is, the more the true cause stands out from corrections; so must a wrong one. A large
drift of a DMA is hardly told from whatever follows the stiffness, so that there no more is asked for.
Where both causes of a pair are there, of d' 9 or 12, it is more probable than what has no name by 1.4 nat or more in 95
of 100 cases (240 pairs), and by 7 in half of them; for one effect of no name, or of a cause taken out, it is in 5.
"""

import dataclasses

from inverse.diagnosis.odds import Odds

SET_LEVEL = 0.01
"""p-value of what is left below which a cause is ruled out."""
UNEXPLAINED_LEVEL = 0.05
"""True causes that may be called `unexplained`, and the p-value below which what is left is conspicuous."""
MOST_OF_PAIR = -1.5
"""Odds of a correction of no name over two causes, in nats, up to which these explain the data."""
MOST_EVIDENCE = 15.0
"""Nats beyond which more evidence asks for no more."""


@dataclasses.dataclass(frozen=True)
class Allowed:
    """Odds of a correction of no name, in nats, up to which one cause is enough.

    Attributes:
        instead: In place of the causes, where there is nothing to see.
        for_evidence: By how much less for each nat of evidence.
        beside: Beside the cause that fits best.
    """

    instead: float
    for_evidence: float
    beside: float

    def instead_at(self, evidence: float) -> float:
        """In place of the causes: the more there is to see, the more probable the true one is."""
        return self.instead - self.for_evidence * min(max(evidence, 0.0), MOST_EVIDENCE)


ALLOWED = {False: Allowed(1.0, 0.0, 3.5), True: Allowed(2.3, 0.2, 2.6)}
"""By whether data are few."""


def enough(odds: Odds, *, few: bool) -> bool:
    """Whether one cause is enough to explain the data.

    Args:
        odds: Of a correction of no name over the causes.
        few: Whether data are few.
    """
    allowed = ALLOWED[few]
    return odds.instead <= allowed.instead_at(odds.evidence) and odds.beside <= allowed.beside
