"""The spline even in r: order, smoothness across the axis, samples kept."""

import numpy as np
import pytest
from scipy import special

from arfjax.numerics.radial_spline import even_spline_matrix
from tests.checks import assert_order


@pytest.mark.parametrize("offset", [0.0, 0.5, 1e-9])
def test_order_is_four_up_to_the_axis(offset):
    points, counts, errors = np.linspace(0.0, 7.9, 300), (20, 40, 80), []
    for count in counts:
        radii = (np.arange(count + 1) + offset) * 8.0 / count
        errors.append(np.abs(even_spline_matrix(points, radii) @ special.j0(radii) - special.j0(points)).max())
    assert_order([1.0 / count for count in counts], errors, order=4.0, slack=0.3)


@pytest.mark.parametrize("first", [0.0, 0.3])
def test_it_keeps_the_samples_and_even_parabolas(first):
    radii = first + np.arange(9.0)
    np.testing.assert_allclose(even_spline_matrix(radii, radii), np.eye(9), atol=1e-14)
    points = np.linspace(0.0, 8.0, 50)
    np.testing.assert_allclose(even_spline_matrix(points, radii) @ (3.0 - radii**2), 3.0 - points**2, atol=1e-12)


@pytest.mark.parametrize("first", [0.0, 0.5])
def test_it_is_level_on_the_axis_whatever_the_samples(first):
    samples = np.random.default_rng(0).normal(size=9)
    value, *near = even_spline_matrix(np.array([0.0, 1e-3, 2e-3]), first + np.arange(9.0)) @ samples
    # A slope s would give s times the distance; what is even goes with its square.
    np.testing.assert_allclose((near[1] - value) / (near[0] - value), 4.0, rtol=5e-3)
