"""The mean of a decay and two derivatives in sixty digits, on both sides of where its series begins."""

from decimal import Decimal, localcontext
from math import factorial, perm

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.numerics.decay import mean_decay

DROPS = [-3.0, -0.1001, -0.0999, -1e-3, -1e-12, 0.0, 1e-12, 1e-3, 0.0999, 0.1001, 2.0, 9.0]


@pytest.mark.parametrize(("order", "tolerance"), [(0, 1e-15), (1, 2e-14), (2, 1e-12)])
def test_value_and_derivatives(order, tolerance):
    """Just above the series the derivative loses digits by a factor of 10, the second by its square."""
    of = mean_decay
    for _ in range(order):
        of = jax.grad(of)
    exact = [_power_series(drop, order) for drop in DROPS]
    np.testing.assert_allclose(jax.vmap(of)(jnp.asarray(DROPS)), exact, rtol=tolerance)


def _power_series(drop, order):
    """Derivative of the sum of (-drop)^n / (n + 1)!, whose terms of 9 reach 900 before they fall."""
    with localcontext(prec=60):
        total, power = Decimal(0), Decimal(1)
        for n in range(order, 90):
            total += (-1) ** n * perm(n, order) * power / factorial(n + 1)
            power *= Decimal(drop)
        return float(total)


def test_nothing_is_left_of_a_long_decay():
    assert float(mean_decay(jnp.asarray(1e300))) == pytest.approx(1e-300, rel=1e-15)
