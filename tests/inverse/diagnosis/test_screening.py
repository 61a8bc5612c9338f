import math

import numpy as np
import pytest
from scipy import stats

from inverse.diagnosis.dma.causes import DMA_CAUSES
from inverse.diagnosis.examination import DETECTABLE, visible_alternatives
from inverse.diagnosis.noise import LOG_PRIOR_OF_STEP, noise_family, series
from inverse.diagnosis.projection import independent, project_out, visibility, visible_columns
from inverse.diagnosis.screening import SIGNALS, Alternative, Screen
from inverse.diagnosis.where import absorbed

RNG = np.random.default_rng(5)
N = 60
FITTED = RNG.standard_normal((N, 4))
CAUSE = RNG.standard_normal((N, 1))
GROUP = RNG.standard_normal((N, 3))
NOTHING = np.zeros(N)
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


def restricted_log_likelihood(data, covariance):
    """Of data with the fitted columns free, the size of the noise at its best; from its definition."""
    basis, _ = np.linalg.qr(FITTED, mode="complete")
    contrasts = basis[:, FITTED.shape[1] :]
    inside, seen = contrasts.T @ covariance @ contrasts, contrasts.T @ data
    freedom = len(seen)
    size = seen @ np.linalg.solve(inside, seen) / freedom
    return -0.5 * freedom * np.log(size) - 0.5 * np.linalg.slogdet(inside)[1]


def test_white_noise_gives_the_t_of_regression():
    data = RNG.standard_normal(N)
    alternatives = [Alternative("one", CAUSE), Alternative("up", CAUSE, 1), Alternative("down", CAUSE, -1)]
    screen = Screen(FITTED, alternatives, WHITE)
    found = screen.statistics(data[:, None])
    t = regression_t(data, np.concatenate([FITTED, CAUSE], axis=1))
    # A strength of one sign stays 0 where it would have to have the other.
    np.testing.assert_allclose(found.statistic[:3, 0], [t, max(t, 0.0), min(t, 0.0)], rtol=1e-10)
    np.testing.assert_allclose(np.exp(found.log_p[0, 0]), 2.0 * stats.t.sf(abs(t), N - 5), rtol=1e-10)
    up, down = (np.exp(found.log_p[row, 0]) for row in (1, 2))
    np.testing.assert_allclose([up, down], stats.t.sf([max(t, 0.0), max(-t, 0.0)], N - 5), rtol=1e-10)


STEPPED = next(n for n in FULL if n.correlation == 0.6 and n.step > 1.0)


def covariance_root(member):
    """What makes noise of this kind of white noise."""
    return member.colour(np.eye(N))


def covariance_of(member):
    root = covariance_root(member)
    return root @ root.T


@pytest.mark.parametrize("family", [WHITE, (STEPPED,)])
def test_process_gains_what_its_covariance_makes_likelier(family):
    data = RNG.standard_normal(N) + 2.0 * GROUP @ [1.0, 0.5, 0.1]
    found = Screen(FITTED, [Alternative("process", GROUP)], family).statistics(data[:, None])
    columns = visible_columns(GROUP, independent(FITTED))
    kernel, noise = columns @ columns.T, covariance_of(family[0])
    # The process's size is measured in coordinates in which the noise is white, fitted parameters projected out.
    white = family[0].whiten(np.eye(N))
    fitted = independent(white @ FITTED)
    left = white - fitted @ (fitted.T @ white)
    kernel = kernel / np.trace(left @ kernel @ left.T)
    without = restricted_log_likelihood(data, noise)
    gains = [restricted_log_likelihood(data, noise + signal**2 * kernel) - without for signal in SIGNALS]
    np.testing.assert_allclose(found.statistic[0, 0], 2.0 * max(gains), rtol=1e-8)
    np.testing.assert_allclose(np.exp(found.log_p[0, 0]), 0.5 * stats.chi2.sf(2.0 * max(gains), 1), rtol=1e-8)


@pytest.mark.parametrize("strength", [1.0, 30.0])
def test_correction_is_the_mean_of_the_likeliest_process(strength):
    data = RNG.standard_normal(N) + strength * GROUP @ [1.0, 0.5, 0.1]
    basis = independent(FITTED)
    left = data - basis @ (basis.T @ data)
    columns = GROUP - basis @ (basis.T @ GROUP)
    kernel = columns @ columns.T / np.sum(columns**2)
    sizes = (*SIGNALS, 25.0, 50.0, 100.0, 200.0)
    best = max(sizes, key=lambda s: restricted_log_likelihood(data, np.eye(N) + s**2 * kernel))
    mean = best**2 * kernel @ np.linalg.solve(np.eye(N) + best**2 * kernel, left)
    np.testing.assert_allclose(absorbed(columns, left, N - 4), mean, atol=1e-9 * np.max(np.abs(left)))
    one = columns[:, :1]
    np.testing.assert_allclose(absorbed(one, left, N - 4), one[:, 0] * (one[:, 0] @ left) / np.sum(one**2), rtol=1e-9)


def test_derivative_that_is_not_finite_is_refused_by_name():
    broken = CAUSE.copy()
    broken[3] = np.nan
    with pytest.raises(ValueError, match="derivative of broken is not finite"):
        Screen(FITTED, [Alternative("broken", broken)], WHITE)


def test_process_is_as_long_after_the_fit_as_it_is_believed_to_be():
    lengths = np.array([1.0, 0.5, 0.2])
    # The first column is all but imitated by the fit, the fourth is a mixture of the first two.
    columns = np.concatenate([FITTED[:, :1] + 0.05 * GROUP[:, :1], GROUP[:, 1:]], axis=1)
    columns = columns / np.linalg.norm(columns, axis=0) * lengths
    columns = np.concatenate([columns, 0.1 * columns[:, :1] + 0.1 * columns[:, 1:2]], axis=1)
    basis = independent(FITTED)
    seen = visible_columns(columns, basis)
    left = seen - basis @ (basis.T @ seen)
    np.testing.assert_allclose(left.T @ left, np.diag(lengths**2), atol=1e-12)


def test_noise_alone_seldom_looks_like_a_process():
    noise = np.random.default_rng(8).standard_normal((N, 4000))
    found = Screen(FITTED, [Alternative("process", GROUP)], WHITE).statistics(noise)
    # Nominal levels are those of a variance in many directions; replicates make them exact (`decision`).
    for level in (0.1, 0.05, 0.01):
        share = np.mean(found.log_p[0] <= np.log(level))
        assert 0.3 * level < share < 1.6 * level


def test_scale_of_data_and_of_directions_does_not_matter():
    data = RNG.standard_normal((N, 3))
    alternatives = [Alternative("one", CAUSE), Alternative("three", GROUP)]
    scaled = [Alternative("one", 1e6 * CAUSE), Alternative("three", 1e-3 * GROUP)]
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
    drawn = screen.replicate(data, np.ones(1), 4000, np.random.default_rng(4))
    basis = independent(FITTED)
    left = data - basis @ (basis.T @ data)
    leverage = np.sum(basis**2, axis=1)
    assert np.mean(drawn**2) == pytest.approx(np.mean(left**2 / (1.0 - leverage)), rel=0.02)
    t = screen.statistics(drawn).statistic[0]
    assert (
        abs(np.mean(t)) < 4.0 / np.sqrt(4000) * np.std(t)
        and abs(screen.statistics(data[:, None]).statistic[0, 0]) > 20.0
    )


@pytest.mark.parametrize("effect", [None, "up", "down", "either"])
def test_noise_is_weighed_by_its_likelihood_with_the_effect_in_the_model(effect):
    """From the definition; the effect of the first sign is there, and of the other one nothing can be taken."""
    data = 3.0 * CAUSE[:, 0] + covariance_root(STEPPED) @ np.random.default_rng(6).standard_normal(N)
    causes = [Alternative(name, CAUSE, sign) for name, sign in (("up", 1), ("down", -1), ("either", 0))]
    screen = Screen(FITTED, [Alternative("free", GROUP), *causes], FULL)
    names = [one.name for one in screen.alternatives]
    found = screen.noise_weights(data, None if effect is None else names.index(effect))
    contrasts = np.linalg.qr(FITTED, mode="complete")[0][:, FITTED.shape[1] :]
    expected = []
    for member in FULL:
        covariance = covariance_of(member)
        along = contrasts @ np.linalg.solve(contrasts.T @ covariance @ contrasts, contrasts.T @ CAUSE[:, 0])
        strength = max(along @ data / (along @ CAUSE[:, 0]), 0.0) if effect in ("up", "either") else 0.0
        log_prior = LOG_PRIOR_OF_STEP * (member.step != 1.0)
        expected.append(restricted_log_likelihood(data - strength * CAUSE[:, 0], covariance) + log_prior)
    expected = np.exp(np.array(expected) - max(expected))
    np.testing.assert_allclose(found, expected / np.sum(expected), rtol=1e-8, atol=1e-12)
    with pytest.raises(ValueError, match="free has several directions"):
        screen.noise_weights(data, names.index("free"))


def test_replicates_are_of_each_kind_in_its_share():
    """Those of the first member alone are what they would be without the others."""
    data, weights = np.random.default_rng(7).standard_normal(N), np.zeros(len(FULL))
    loudest = np.argmax([member.step for member in FULL])
    weights[[0, loudest]] = 0.75, 0.25
    screen = Screen(FITTED, [Alternative("one", CAUSE)], FULL)
    mixed = screen.replicate(data, weights, 400, np.random.default_rng(8))
    white = Screen(FITTED, [Alternative("one", CAUSE)], WHITE)
    np.testing.assert_array_equal(mixed[:, :300], white.replicate(data, np.ones(1), 300, np.random.default_rng(8)))
    louder = FULL[loudest].log_deviation > 0.0
    # Of 3000 values on either side a ratio of deviations is known to 2 percent.
    ratio = np.std(mixed[louder, 300:]) / np.std(mixed[~louder, 300:])
    alike = screen.replicate(data, np.full(len(FULL), 1.0 / len(FULL)), 100, np.random.default_rng(9))
    assert mixed.shape == (N, 400) and alike.shape == (N, 100) and ratio == pytest.approx(FULL[loudest].step, rel=0.08)


@pytest.mark.parametrize("wide", [0.3, 2.0])
def test_replicates_of_beliefs_are_as_wide_as_they_came_out(wide):
    """Whatever their width, readings are drawn as they would be without them."""
    rng, beliefs, count = np.random.default_rng(10), 9, 400
    member = next(n for n in FULL if n.correlation == 0.4 and n.step == 1.0)
    # Of nine constants six are known by readings, three by belief alone.
    seen = np.append(rng.standard_normal((N, 6)), np.zeros((N, 3)), axis=1)
    fitted = np.append(10.0 * seen, np.eye(beliefs), axis=0)
    together, alone = ([one] for one in (member.extended(beliefs), member))
    of_readings, of_beliefs = [], []
    for _ in range(50):
        data = np.append(member.colour(rng.standard_normal((N, 1)))[:, 0], wide * rng.standard_normal(beliefs))
        screen = Screen(fitted, [Alternative("one", np.append(CAUSE, np.zeros((beliefs, 1)), axis=0))], together)
        drawn = screen.replicate(data, np.ones(1), count, rng)
        of_readings.append(np.mean(member.whiten(drawn[:N]) ** 2))
        of_beliefs.append(np.mean(drawn[N:] ** 2))
    # Six constants tell 1 / sqrt(3) of a variance, in 50 sets 8 percent; one in seven counts as a reading.
    assert np.mean(of_beliefs) == pytest.approx((6.0 * wide**2 + 1.0) / 7.0, rel=0.25)
    assert np.mean(of_readings) == pytest.approx(1.0, rel=0.1)
    assert alone[0].beliefs == 0 == together[0].of_first(N).beliefs and together[0].of_first(N + 2).beliefs == 2


def test_visibility():
    np.testing.assert_allclose(visibility(FITTED[:, :1] + FITTED[:, 2:3], FITTED), 0.0, atol=1e-12)
    orthogonal = CAUSE - independent(FITTED) @ (independent(FITTED).T @ CAUSE)
    np.testing.assert_allclose(visibility(orthogonal, FITTED), 1.0, rtol=1e-12)


def test_what_the_fit_imitates_is_left_out():
    alone = FITTED @ np.arange(1.0, 1.0 + FITTED.shape[1])[:, None]
    imitated = [Alternative("several", FITTED[:, :2]), Alternative("alone", alone), Alternative("none", 0.0 * CAUSE)]
    screen = Screen(FITTED, [*imitated, Alternative("one", CAUSE)], WHITE)
    assert [a.name for a in screen.alternatives] == ["one"]


@pytest.mark.parametrize(
    ("name", "farthest", "words"),
    [
        # Plausible is 0.3, and all that is there to slip is gone at 1.
        ("slip", 0.95, "0.96 to be seen, where there is none above 0.95"),
        ("drying", 3.0, "3 to be seen, where 0.3 is plausible"),
    ],
)
def test_a_cause_that_shows_only_where_it_cannot_be_is_not_testable(name, farthest, words):
    cause = next(one for one in DMA_CAUSES if one.name == name)
    direction = CAUSE - independent(FITTED) @ (independent(FITTED).T @ CAUSE)
    for factor, hidden in ((0.99, False), (1.01, True)):
        size = factor * farthest * float(np.linalg.norm(direction)) / DETECTABLE
        seen, not_testable = visible_alternatives([Alternative(name, direction, 1)], NOTHING, FITTED, size, [cause])
        assert (len(seen), len(not_testable)) == ((0, 1) if hidden else (1, 0))
    assert f"it would have to be {words}" in not_testable[0].why


def test_a_large_effect_does_not_hide_behind_itself():
    """Residuals that hold it are large; those that it would leave are not. One of the other sign leaves all of them."""
    slip = next(one for one in DMA_CAUSES if one.name == "slip")
    basis = independent(FITTED)
    direction, noise = project_out(np.column_stack([CAUSE[:, 0], np.cos(7.0 * np.arange(len(CAUSE)))]), basis).T
    noise -= direction * (direction @ noise) / (direction @ direction)
    # Left alone, noise is as large as makes a strength of 0.5 detectable, where 0.9 is the most that there can be.
    freedom = len(CAUSE) - basis.shape[1]
    noise *= 0.5 * np.linalg.norm(direction) / DETECTABLE * math.sqrt(freedom - 1) / np.linalg.norm(noise)
    residuals = noise + 0.9 * direction
    size = float(np.linalg.norm(residuals)) / math.sqrt(freedom)
    hidden_behind = DETECTABLE * size / float(np.linalg.norm(direction))
    for sign, strength in ((1, 0.5), (-1, hidden_behind)):
        for factor, seen in ((1.0001, 1), (0.9999, 0)):
            end = factor * strength
            bounded = type("Bounded", (type(slip),), {"sign": 0, "least": -end, "largest": end})()
            either = [Alternative("slip", direction[:, None], sign)]
            assert len(visible_alternatives(either, residuals, FITTED, size, [bounded])[0]) == seen


@pytest.mark.parametrize(
    ("least", "largest", "signs", "words"),
    [
        (-1.0, math.inf, (1,), ""),
        (-math.inf, 1.0, (-1,), ""),
        (-1.0, 1.5, (), "2 to be seen, where there is none above 1.5"),
        (-1.5, 1.0, (), "-2 to be seen, where there is none below -1.5"),
    ],
)
def test_either_side_of_a_cause_has_an_end_of_its_own(least, largest, signs, words):
    direction = CAUSE - independent(FITTED) @ (independent(FITTED).T @ CAUSE)
    size = 2.0 * float(np.linalg.norm(direction)) / DETECTABLE
    said = {"sign": 0, "unit": "1", "plausible": 1.0, "least": least, "largest": largest}
    ends = type("Ends", (type(DMA_CAUSES[0]),), said)()
    both = [Alternative(ends.name, direction, sign) for sign in (1, -1)]
    seen, not_testable = visible_alternatives(both, NOTHING, FITTED, size, [ends])
    assert tuple(one.sign for one in seen) == signs
    assert [one.why for one in not_testable] == ([f"it would have to be {words}"] if words else [])


def test_what_is_too_weak_is_told_of_a_shape_that_can_be_told():
    """Not of one that would take less, and that the fitted constants imitate."""
    direction = CAUSE - independent(FITTED) @ (independent(FITTED).T @ CAUSE)
    imitated = 1e4 * FITTED[:, :1] + 20.0 * direction
    size = 45.0 * float(np.linalg.norm(direction)) / DETECTABLE
    shapes = [Alternative("slip", direction, 1, 1.0), Alternative("slip", imitated, 1, 2.0)]
    slip = next(one for one in DMA_CAUSES if one.name == "slip")
    _, (hidden,) = visible_alternatives(shapes, NOTHING, FITTED, size, [slip])
    assert hidden.why.startswith("it would have to be 45 to be seen")
