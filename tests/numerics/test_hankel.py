"""The Hankel basis: an exact pair, spectrally accurate transforms and integrals."""

import numpy as np
import pytest
from scipy import special

from arfjax.numerics.hankel import hankel_basis

WIDTH = 5e-3


@pytest.fixture
def basis():
    return hankel_basis(96, 40e-3)


def test_the_pair_is_inverse_and_nearly_orthogonal(basis):
    np.testing.assert_allclose(basis.from_series @ basis.to_series, np.eye(96), atol=1e-13)
    orthogonal = basis.from_series.T * basis.weights[None, :] / basis.norms[:, None]
    np.testing.assert_allclose(basis.to_series, orthogonal, atol=1e-8)


def test_coefficients_of_a_gaussian_are_its_transform(basis):
    coefficients = basis.to_series @ np.exp(-((basis.nodes / WIDTH) ** 2))
    transform = 0.5 * WIDTH**2 * np.exp(-((basis.wavenumbers * WIDTH / 2.0) ** 2))
    np.testing.assert_allclose(coefficients, transform / basis.norms, atol=1e-13)


def test_the_series_is_exact_between_nodes_and_on_the_axis(basis):
    r = np.array([0.0, 1e-6, 3.3e-3, 9e-3])
    coefficients = basis.to_series @ np.exp(-((basis.nodes / WIDTH) ** 2))
    np.testing.assert_allclose(basis.evaluation_matrix(r) @ coefficients, np.exp(-((r / WIDTH) ** 2)), atol=1e-13)
    np.testing.assert_array_equal(
        basis.evaluation_matrix(basis.nodes[3:4])[0, 0], special.j0(basis.nodes[3] * basis.wavenumbers[0])
    )


def test_integrals(basis):
    gaussian = np.exp(-((basis.nodes / WIDTH) ** 2))
    np.testing.assert_allclose(basis.weights @ gaussian, 0.5 * WIDTH**2, rtol=1e-12)
    coefficients = basis.to_series @ gaussian
    np.testing.assert_allclose(np.sum(basis.norms * coefficients**2), 0.25 * WIDTH**2, rtol=1e-12)
