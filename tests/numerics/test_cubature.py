"""Few points with positive weights integrate what they were chosen for."""

import numpy as np

from arfjax.numerics.cubature import few_points


def test_polynomials_are_integrated_by_few_of_many_points():
    x = np.linspace(-1.0, 1.0, 2000)
    powers = np.stack([x**k for k in range(12)]) / len(x)
    chosen, weights = few_points(powers, tolerance=1e-9)
    assert len(chosen) <= 12 and np.all(weights > 0.0)
    np.testing.assert_allclose(powers[:, chosen] @ weights, powers.sum(axis=1), atol=1e-8)


def test_a_smaller_tolerance_takes_more_points_and_errs_less():
    x = np.linspace(0.0, 1.0, 500)
    integrands = np.stack([np.exp(-k * x) for k in range(40)]) / len(x)
    counts, errors = [], []
    for tolerance in (1e-2, 1e-5):
        chosen, weights = few_points(integrands, tolerance=tolerance)
        sums = integrands.sum(axis=1)
        counts.append(len(chosen))
        errors.append(np.linalg.norm(integrands[:, chosen] @ weights - sums) / np.linalg.norm(sums))
    assert counts[0] < counts[1]
    assert errors[0] < 30.0 * 1e-2 and errors[1] < 30.0 * 1e-5
