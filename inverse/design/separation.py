r"""How well a measurement tells causes apart, in the linearised model.

With the fitted constants projected out, cause i of strength $s_i$ moves the data by $d_i = |s_i| \| c_i \| / \sigma$
standard deviations, and $\rho$ is the cosine between what two causes do to the data. The right one of two has the
larger statistic with probability $\Phi(d_i \sqrt{(1 - \rho) / 2})$, where $|\rho|$ stands for $\rho$ if the other one
may have either sign: one that may not is no answer to data that go the opposite way.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

from inverse.diagnosis.projection import independent


@dataclasses.dataclass(frozen=True)
class Separation:
    """Of some causes by one design.

    Attributes:
        names: Of the causes.
        d_prime: Strength of each in standard deviations, fitted constants projected out.
        cosine: Between what they do to the data at these strengths, fitted constants projected out.
        one_sided: Which of them can have no other sign.
    """

    names: tuple[str, ...]
    d_prime: Float[np.ndarray, " cause"]
    cosine: Float[np.ndarray, "cause cause"]
    one_sided: Bool[np.ndarray, " cause"]

    @property
    def likeness(self) -> Float[np.ndarray, "cause cause"]:
        """How far the cause of the column can do what that of the row does: 1 for all of it."""
        return np.where(self.one_sided[None, :], self.cosine, np.abs(self.cosine))

    @property
    def right(self) -> Float[np.ndarray, "cause cause"]:
        """Probability that the cause of the row, if it is the true one, looks likelier than that of the column."""
        apart = np.sqrt(np.maximum(1.0 - self.likeness, 0.0) / 2.0)
        return stats.norm.cdf(self.d_prime[:, None] * apart)

    @property
    def worst(self) -> float:
        """The least of these over all pairs; NaN for one cause alone."""
        off = ~np.eye(len(self.names), dtype=bool)
        return float(np.min(self.right[off])) if np.any(off) else float("nan")

    @property
    def closest(self) -> tuple[int, int]:
        """Places of the two that are the hardest to tell apart."""
        right = np.where(np.eye(len(self.names), dtype=bool), np.inf, self.right)
        one, other = np.unravel_index(int(np.argmin(right)), right.shape)
        return int(one), int(other)

    @property
    def angle(self) -> float:
        """The least angle between what two causes do [deg]; NaN for one cause alone.

        From 0 to 90 if one of the two may have either sign, else to 180.
        """
        off = ~np.eye(len(self.names), dtype=bool)
        closest = np.max(self.likeness[off]) if np.any(off) else float("nan")
        return float(np.degrees(np.arccos(np.clip(closest, -1.0, 1.0))))


def separation(
    names: Sequence[str],
    directions: Float[np.ndarray, "n cause"],
    strengths: Float[np.ndarray, " cause"],
    fitted: Float[np.ndarray, "n p"],
    size: float,
    signs: Sequence[int],
) -> Separation:
    """Tell how well a design separates causes.

    Args:
        names: Of the causes.
        directions: Derivative of the weighted prediction in each strength.
        strengths: That each would have.
        fitted: Derivative in what is fitted.
        size: Standard deviation of the noise, in units of the weights.
        signs: That each must have; 0 for either.
    """
    basis = independent(fitted)
    left = directions - basis @ (basis.T @ directions)
    lengths = np.linalg.norm(left, axis=0)
    one_sided = np.asarray(signs, dtype=int) != 0
    way = np.where(one_sided, signs, np.where(strengths < 0.0, -1, 1))
    units = way * left / np.maximum(lengths, 1e-300)
    return Separation(tuple(names), np.abs(strengths) * lengths / size, units.T @ units, one_sided)
