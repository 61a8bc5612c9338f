"""What one cause has to explain: a rule for many data, and one for few.

Both weigh what the cause leaves, and by how much a correction of no name beats the best cause. Of many data either is
conspicuous by itself where a cause is wrong. Of few, as curves of displacement are, a wrong cause takes so much that
neither is, and the one is asked for more the more there is of the other.

Measured on linear curves of development seeds, the rule for many -> that for few: `unexplained` were 64.1 -> 70.5 of
100 effects in no list (78 sets), 41.5 -> 46.5 of causes taken out of the list (159), each of d' 9, and of true causes
3.2 -> 1.9 (314, d' 4.5 to 9; 5.3 -> 4.8 of 869 others, with fewer replicates of what is left). Of two causes at once,
d' 9 or 12 each, 78.8 -> 80.8 of 100 pairs were among the explanations (104). To ask a t of 6.4 and more of each of two
makes 6 more of 100 effects of no name and causes taken out unexplained, and of true pairs 5.

Not in: corrections that are smooth along temperature in all sonications alike, or any that they share, tested by
themselves beside the best-fitting cause, three times the p of which has to reach `least_p`, too (`LEAST_P` 0.20 or
0.25). Of 115 effects in no list one cause is not enough for 87, and would not be for 90 to 92; of 92 causes taken out
for 49 and 50; of 388 true causes for 19 and 19 to 26.

A dynamic mechanical analysis has nothing to gain by the rule for few (of causes taken out 77.7 -> 77.7, of true ones
3.7 -> 4.5; 130 and 134 sets).
"""

import math
from collections.abc import Sequence

from inverse.diagnosis.evidence import Evidence

SET_LEVEL = 0.01
"""p-value of what is left below which a cause is ruled out."""
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
LEAST_P = 0.25
"""p-value that the best-fitting cause has to leave where data are few and no free form leads."""
_NATS_FOR_E = 3.0


def least_p(lead: float) -> float:
    """p-value that the best-fitting cause has to leave where data are few: the better a free form does, the more.

    Above 1 none is enough.
    """
    return max(SET_LEVEL, LEAST_P * math.exp(min(lead / _NATS_FOR_E, 9.0)))


def enough(left: Sequence[Evidence], lead: float, *, few: bool) -> bool:
    """Whether one cause is enough to explain the data: of few the best-fitting one, of many any.

    Args:
        left: The test of what each cause leaves whose refit converged, the best fit first.
        lead: Nats by which the best free form is more improbable as noise than the best cause.
        few: Whether data are few.
    """
    if not left:
        return False
    if few:
        return left[0].p_value >= least_p(lead)
    return lead <= LEAD_OF_FREE_FORMS and max(one.p_value for one in left) >= UNEXPLAINED_LEVEL
