import numpy as np
import pytest

from inverse.diagnosis.noise import Noise, noise_family, series

POSITIONS = np.array([3.0, 1.0, 2.0, 4.0, 1.5, 0.5])
KEYS = ["a", "a", "a", "a", "b", "b"]
COORDINATE = np.array([3.0, 1.0, 2.0, 4.0, 1.5, 0.5])


def covariance(noise: Noise) -> np.ndarray:
    """From the definition: deviations, and powers of the correlation within each series."""
    count = len(POSITIONS)
    deviation = np.exp(noise.log_deviation)
    rank = {}
    for key in set(KEYS):
        members = [i for i in range(count) if KEYS[i] == key]
        for place, index in enumerate(sorted(members, key=lambda i: POSITIONS[i])):
            rank[index] = place
    return np.array(
        [
            [
                deviation[i]
                * deviation[j]
                * (noise.correlation ** abs(rank[i] - rank[j]) if KEYS[i] == KEYS[j] else 0.0)
                for j in range(count)
            ]
            for i in range(count)
        ]
    )


@pytest.fixture(scope="module")
def family():
    return noise_family([series("frequency", KEYS, POSITIONS)], COORDINATE)


def test_whitening_makes_the_covariance_the_identity(family):
    assert any(n.correlation for n in family) and any(n.step != 1.0 for n in family)
    for noise in family:
        root = noise.whiten(np.eye(6))
        np.testing.assert_allclose(root @ covariance(noise) @ root.T, np.eye(6), atol=1e-12)
        np.testing.assert_allclose(noise.colour(root), np.eye(6), atol=1e-12)
        assert noise.log_determinant == pytest.approx(np.linalg.slogdet(covariance(noise))[1], abs=1e-12)


def test_first_member_is_white_and_costs_nothing(family):
    assert family[0].is_white and family[0].log_prior == 0.0
    assert all(n.log_prior < 0.0 and not n.is_white for n in family[1:])
    assert "times larger above" in " ".join(n.describe() for n in family)


def test_neighbours_are_within_a_series_and_in_order():
    np.testing.assert_array_equal(series("frequency", KEYS, POSITIONS).previous, [2, -1, 1, 0, 5, -1])
