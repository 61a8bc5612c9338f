"""Weights of few points that integrate a set of functions as all points do."""

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls


def few_points(
    integrands: Float[np.ndarray, "integrand point"], *, tolerance: float
) -> tuple[Int[np.ndarray, " chosen"], Float[np.ndarray, " chosen"]]:
    """Points and positive weights that sum integrands nearly as all points do.

    The integrands are first compressed to their principal combinations, since many of them are much alike; those are
    summed exactly where that can be done with positive weights, and there are at most as many points as combinations.

    Args:
        integrands: Value of each at every point, times the weight that the point has among all.
        tolerance: Combinations together smaller than half of this share of the sums are left out. What they sum to at
            the points chosen is not controlled: some ten times as much.

    Returns:
        Indices of the points, ascending, and what to multiply their values with.

    Source: empirical cubature by non-negative least squares (Lawson & Hanson, Solving least squares problems, 1974,
        ch. 23; Farhat, Chapman & Avery, Int. J. Numer. Meth. Engng 102 (2015) 1077).
    """
    left, size, right = np.linalg.svd(integrands, full_matrices=False)
    sums = size * right.sum(axis=1)
    allowed = 0.5 * tolerance * np.linalg.norm(sums)
    rest = np.sqrt(np.cumsum((size**2)[::-1]))[::-1]
    count = max(int(np.sum(rest > allowed)), 1)
    weights, _ = nnls(size[:count, None] * right[:count], sums[:count], maxiter=30 * count)
    chosen = np.flatnonzero(weights > 0.0)
    return chosen, weights[chosen]
