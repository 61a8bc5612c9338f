"""What one cause has to explain, and what two: the odds of a correction of no name up to which they are enough.

Limits are chosen so that about 5 of 100 true causes at most are called `unexplained`, whatever their size and however
many data there are. Measured on development sets, by the odds alone, of 100:

- Linear curves of 57 readings: true causes of d' 4.5 and 6 2.0 and 3.1 (654 sets each); effects in no list of d' 9 84
  (500), causes taken out 74 (510); of d' 5 39 and 43. By p-values of what the best cause leaves, with the lead of the
  best correction over the best cause, which this replaces, 70 and 47 were of d' 9.
- Eleven readings, at the places of the paper's: true causes of d' 3 to 9 6 to 7 (480 each). What the paper's own
  say was known when these limits were chosen: they are near `MOST_BESIDE` and test nothing of it.
- A dynamic mechanical analysis, refits in full: true causes of d' 4.5 and 6 3 and 4 (71 and 72), effects in no list 100
  (53), causes taken out 85 (67; 64 before).

To allow less where there is more to see would gain 3 of 100 effects on curves, and lose true causes where readings are
few, or where a large one is imitated: a large drift of a DMA is hardly told from whatever follows the stiffness.

Where both causes of a pair are there, of d' 9 or 12, it is more probable than what has no name by 1.4 nat or more in 95
of 100 cases (240 pairs), and by 7 in half of them; for one effect of no name, or of a cause taken out, it is in 5.
"""

from inverse.diagnosis.odds import Odds

SET_LEVEL = 0.01
"""p-value of what is left below which a cause is ruled out."""
UNEXPLAINED_LEVEL = 0.05
"""True causes that may be called `unexplained`, and the p-value below which what is left is conspicuous."""
MOST_INSTEAD, MOST_BESIDE = 1.0, 3.0
"""Odds of a correction of no name, in nats, in place of all causes and beside the one that fits best, up to which one
cause is enough."""
MOST_OF_PAIR = -1.5
"""The same over two causes."""


def enough(odds: Odds) -> bool:
    """Whether one cause is enough to explain the data.

    Args:
        odds: Of a correction of no name over the causes.
    """
    return odds.instead <= MOST_INSTEAD and odds.beside <= MOST_BESIDE
