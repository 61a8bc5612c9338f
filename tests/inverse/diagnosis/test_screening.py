import numpy as np
import pytest
from scipy import stats

from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative, Screen, independent, visibility

RNG = np.random.default_rng(5)
N = 60
FITTED = RNG.standard_normal((N, 4))
CAUSE = RNG.standard_normal((N, 1))
GROUP = RNG.standard_normal((N, 3))
POSITION = np.arange(N, dtype=float)
ORDER = series("time", [0] * N, POSITION)
WHITE = noise_family([ORDER], POSITION)[:1]
FULL = noise_family([ORDER], POSITION + 1.0)


def regression_t(data, columns):
    """t of the last column in ordinary least squares."""
    solution = np.linalg.lstsq(columns, data, rcond=None)[0]
    rest = data - columns @ solution
    variance = rest @ rest / (len(data) - columns.shape[1])
    return solution[-1] / np.sqrt(variance * np.linalg.inv(columns.T @ columns)[-1, -1])


def test_white_noise_gives_the_t_and_f_of_regression():
    data = RNG.standard_normal(N)
    alternatives = [Alternative("one", CAUSE), Alternative("up", CAUSE, 1), Alternative("down", -CAUSE, 1)]
    screen = Screen(FITTED, [*alternatives, Alternative("three", GROUP)], WHITE)
    found = screen.statistics(data[:, None])
    t = regression_t(data, np.concatenate([FITTED, CAUSE], axis=1))
    # A strength that cannot be negative stays 0 where it would have to be.
    np.testing.assert_allclose(found.statistic[:3, 0], [t, max(t, 0.0), max(-t, 0.0)], rtol=1e-10)
    np.testing.assert_allclose(np.exp(found.log_p[0, 0]), 2.0 * stats.t.sf(abs(t), N - 5), rtol=1e-10)
    up, down = (np.exp(found.log_p[row, 0]) for row in (1, 2))
    np.testing.assert_allclose([up, down], stats.t.sf([max(t, 0.0), max(-t, 0.0)], N - 5), rtol=1e-10)
    before = np.linalg.lstsq(FITTED, data, rcond=None)[1][0]
    after = np.linalg.lstsq(np.concatenate([FITTED, GROUP], axis=1), data, rcond=None)[1][0]
    f = (before - after) / 3.0 / (after / (N - 7))
    np.testing.assert_allclose(found.statistic[3, 0], f, rtol=1e-10)
    np.testing.assert_allclose(np.exp(found.log_p[3, 0]), stats.f.sf(f, 3, N - 7), rtol=1e-10)


def test_scale_of_data_and_of_directions_does_not_matter():
    data = RNG.standard_normal((N, 3))
    alternatives = [Alternative("one", CAUSE), Alternative("three", GROUP)]
    scaled = [Alternative("one", 1e6 * CAUSE), Alternative("three", GROUP * np.array([1e-3, 1.0, 1e5]))]
    first = Screen(FITTED, alternatives, FULL).statistics(data)
    second = Screen(FITTED * np.array([1.0, 1e8, 1e-6, 1.0]), scaled, FULL).statistics(1e-3 * data)
    np.testing.assert_allclose(second.statistic, first.statistic, rtol=1e-6)
    np.testing.assert_array_equal(second.noise, first.noise)


def test_finds_the_noise_that_is_there():
    member = next(n for n in FULL if n.correlation == 0.8 and n.step == 1.0)
    drawn = member.colour(np.random.default_rng(1).standard_normal((N, 300)))
    screen = Screen(FITTED, [Alternative("one", CAUSE)], FULL)
    found = screen.statistics(drawn)
    correlations = np.array([n.correlation for n in FULL])[found.noise[0]]
    assert np.mean(correlations >= 0.6) > 0.8
    gain, _, _ = screen.noise_evidence(drawn)
    white, _, _ = screen.noise_evidence(np.random.default_rng(2).standard_normal((N, 300)))
    assert np.median(gain) > np.quantile(white, 0.99)


def test_replicates_keep_size_and_tails_and_lose_the_effect():
    data = 3.0 * np.random.default_rng(3).standard_t(4, N) + 20.0 * CAUSE[:, 0]
    screen = Screen(FITTED, [Alternative("one", CAUSE)], WHITE)
    drawn = screen.replicate(data, 0, 4000, np.random.default_rng(4))
    basis = independent(FITTED)
    left = data - basis @ (basis.T @ data)
    leverage = np.sum(basis**2, axis=1)
    assert np.mean(drawn**2) == pytest.approx(np.mean(left**2 / (1.0 - leverage)), rel=0.02)
    t = screen.statistics(drawn).statistic[0]
    assert (
        abs(np.mean(t)) < 4.0 / np.sqrt(4000) * np.std(t)
        and abs(screen.statistics(data[:, None]).statistic[0, 0]) > 20.0
    )


def test_visibility():
    np.testing.assert_allclose(visibility(FITTED[:, :1] + FITTED[:, 2:3], FITTED), 0.0, atol=1e-12)
    orthogonal = CAUSE - independent(FITTED) @ (independent(FITTED).T @ CAUSE)
    np.testing.assert_allclose(visibility(orthogonal, FITTED), 1.0, rtol=1e-12)


def test_what_the_fit_imitates_is_left_out():
    screen = Screen(FITTED, [Alternative("imitated", FITTED[:, :2]), Alternative("one", CAUSE)], WHITE)
    assert [a.name for a in screen.alternatives] == ["one"]
