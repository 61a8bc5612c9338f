"""What one cause has to explain, and what each of two has to have: a rule for many data, and one for few.

Both hold what the cause leaves against how much better than any cause a correction of no name describes the data. Many
data tell either by itself. Of few, as curves of displacement are, a wrong cause takes so much that neither is
conspicuous, and both are added up.

Measured on linear curves of development seeds, the rule for many -> that for few: `unexplained` were 60.6 -> 72.4 of
100 effects in no list (170 sets), 43.0 -> 50.8 of causes taken out of the list (321 sets), each of d' 9, and of true
causes 4.9 -> 5.2 at d' 4.5, 4.4 -> 4.1 at 6, 8.1 -> 4.4 at 9 (869 sets). Of two causes at once, of d' 9 or 12 each,
75.7 -> 74.1 of 100 pairs were among the explanations (378 sets). A dynamic mechanical analysis of five temperatures has
nothing to gain: of causes taken out 77.7 -> 77.7 (130 sets) where as many true ones are `unexplained`, and its pairs
lose.
"""

from collections.abc import Sequence

import numpy as np

from inverse.diagnosis.evidence import Evidence

UNEXPLAINED_LEVEL = 0.05
"""p-value of what is left below which a cause does not explain many data. It was 0.06 before `LEAD_OF_FREE_FORMS`,
which finds what that gains: 0.04 to 0.06 call the same effects of no name unexplained (156 development sets), and 0.06
one true one more in a hundred (118 of d' 6)."""
LEAD_OF_FREE_FORMS = 0.5
"""Nats by which the best free form may be more improbable as noise than any cause, each calibrated among its kind,
where data are many.

What a wrong cause leaves of an effect of no name is often too little to be conspicuous, where the whole of it still
looks more like a free form. Measured on development sets, without -> with this: of causes taken out of the list
55 -> 73 of 100 were unexplained at d' = 9 (136 sets) and 15 -> 33 at d' = 5 (133), of true ones 3.9 -> 4.3 (232). Test
sets of DMA gain less: 54 -> 61 and 20 -> 28 (204 sets each), of effects in no list 85 -> 93 (138), of true ones
3.2 -> 4.6 at d' 4.5 (216).

It scatters with the replicates by 0.3. A single direction is tested by Student's t and a process by the likelihood
ratio: at a gain of 20 nats that is worth 0.2 to the process among 140 data and 0.5 among 57."""
MOST_OF_BOTH = -0.9
"""Nats that what the best-fitting cause leaves and a share of the lead may add up to where data are few; it leaves 0 if
noise alone leaves as much in one of twenty."""
SHARE_OF_LEAD = 0.5
_CLEAR_LEAD = 6.0
"""Nats of lead beyond which more says nothing more."""
_NEEDED = 4.5
_NEEDED_BESIDE_A_FREE_FORM = 6.4
_AND_FOR_A_NAT = 0.1


def enough(left: Sequence[Evidence], lead: float, *, few: bool) -> bool:
    """Whether one cause is enough to explain the data.

    Args:
        left: The test of what each cause leaves whose refit converged, the best fit first.
        lead: Nats by which the best free form is more improbable as noise than any cause.
        few: Whether data are few.
    """
    if not left:
        return False
    if few:
        return both(left[0], lead) <= MOST_OF_BOTH
    return lead <= LEAD_OF_FREE_FORMS and max(one.p_value for one in left) >= UNEXPLAINED_LEVEL


def both(left: Evidence, lead: float) -> float:
    """What a cause leaves, beyond what noise alone leaves in one of twenty, and a share of the lead; nats."""
    return left.statistic + SHARE_OF_LEAD * float(np.clip(lead, -_CLEAR_LEAD, _CLEAR_LEAD))


def needed(lead: float, *, few: bool) -> float:
    """T that each cause of a pair must have beside the other; see `enough`.

    Of few data two wrong causes take nearly everything: the closer a free form comes to the best cause, the more each
    has to have.
    """
    return max(_NEEDED, _NEEDED_BESIDE_A_FREE_FORM + _AND_FOR_A_NAT * lead) if few else _NEEDED
