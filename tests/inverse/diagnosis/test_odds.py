"""How probable data are with a cause, with a correction of no name and with neither, against integrals done in full."""

import dataclasses

import numpy as np
import pytest
from scipy import integrate, special, stats

from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.odds import FEWEST_MIXED, MIXTURE, NO_ODDS, Weighed, believed, odds, odds_of_pair, weighed
from inverse.diagnosis.projection import independent, project_out
from inverse.diagnosis.screening import SIGNALS, Alternative, Screen

N = 12
X = np.linspace(0.0, 1.0, N)
FITTED = np.column_stack([np.ones(N), X])
WHITE = noise_family((series("time", [0] * N, X),), X)[:1]
RNG = np.random.default_rng(7)
DATA = RNG.standard_normal(N) + 2.0 * np.sin(5.0 * X)
WAVE = np.sin(5.0 * X)[:, None]
RIPPLES = np.stack([np.cos(k * np.pi * X) for k in (2.0, 3.0, 5.0)], axis=-1) * np.array([1.0, 0.5, 0.2])


def projected(columns):
    basis = np.linalg.svd(FITTED)[0][:, 2:]
    return basis.T @ columns


def probability(covariance, sign=0, direction=None, variance=None):
    """Of the data beside the fit, the size of the noise averaged over as 1 / size; of a sign, strengths beyond 0."""
    left, count = projected(DATA), N - 2

    def of_size(log_size):
        size = np.exp(log_size)
        density = stats.multivariate_normal(np.zeros(count), size**2 * covariance).pdf(left)
        if sign:
            # Given the data a strength is normal: what counts is the part of it that has the sign.
            spread = size**2 * variance / (1.0 + variance)
            middle = sign * float(direction @ left) * variance / (1.0 + variance)
            density *= 2.0 * special.ndtr(middle / np.sqrt(spread))
        return density

    return integrate.quad(of_size, -4.0, 5.0, epsrel=1e-11, epsabs=0.0, limit=200)[0]


@pytest.mark.parametrize("sign", [0, 1, -1])
def test_a_cause_of_one_strength_against_the_integral(sign):
    screen = Screen(FITTED, [Alternative("wave", WAVE, sign)], WHITE)
    found, nothing = screen.log_evidence(DATA[:, None])
    unit = projected(WAVE)[:, 0] / np.linalg.norm(projected(WAVE))
    identity = np.eye(N - 2)
    with_cause = [probability(identity + signal**2 * np.outer(unit, unit), sign, unit, signal**2) for signal in SIGNALS]
    expected = np.log(np.mean(with_cause) / probability(identity))
    assert found[0, 0] - nothing[0] == pytest.approx(expected, abs=1e-8)


def test_a_correction_of_several_strengths_against_the_integral():
    """Its columns are taken as `visible_columns` leaves them, their variance 1 in sum beside the fit."""
    screen = Screen(FITTED, [Alternative("ripples", RIPPLES)], WHITE)
    found, nothing = screen.log_evidence(DATA[:, None])
    columns = projected(screen._columns)
    shape = columns @ columns.T / np.trace(columns @ columns.T)
    identity = np.eye(N - 2)
    expected = np.log(np.mean([probability(identity + s**2 * shape) for s in SIGNALS]) / probability(identity))
    assert found[0, 0] - nothing[0] == pytest.approx(expected, abs=1e-8)


def test_kinds_of_noise_share_what_is_believed_of_them():
    family = noise_family((series("time", [0] * 40, np.arange(40.0)),), np.arange(40.0))
    kept = believed(family)
    share = {}
    for noise in kept:
        assert noise.correlation == 0.0 or noise.step == 1.0
        kind = (noise.correlation > 0.0, noise.step != 1.0)
        share[kind] = share.get(kind, 0.0) + np.exp(noise.log_prior)
    assert share == pytest.approx({(False, False): 0.95, (True, False): 0.03, (False, True): 0.02})
    # What several kinds of noise say is added up, each by what is believed of it.
    data = np.random.default_rng(2).standard_normal((40, 3))
    fitted, cause = np.ones((40, 1)), [Alternative("wave", np.sin(np.arange(40.0))[:, None])]
    both, nothing = Screen(fitted, cause, kept).log_evidence(data)
    each = [Screen(fitted, cause, [noise]).log_evidence(data) for noise in kept]
    np.testing.assert_allclose(both, special.logsumexp([one for one, _ in each], axis=0), rtol=1e-12)
    np.testing.assert_allclose(nothing, special.logsumexp([none for _, none in each], axis=0), rtol=1e-12)


def test_shapes_of_a_cause_are_one_and_kinds_of_corrections_are_many():
    shapes = [Alternative("wave", np.sin(k * X)[:, None], shape=k) for k in (5.0, 6.0, 7.0)]
    step = Alternative("step", (X > 0.5).astype(float)[:, None])
    forms = [Alternative(f"ripple-{k}", np.cos(k * np.pi * X)[:, None]) for k in (2, 3)]
    found = weighed(DATA, FITTED, [*shapes, step], [*forms, Alternative("smooth", RIPPLES)], WHITE)
    assert set(found.causes) == {"wave", "step"} and set(found.corrections) == {"ripple", "smooth"}
    alone = [weighed(DATA, FITTED, [one], [], WHITE).causes["wave"] for one in shapes]
    assert found.causes["wave"] == pytest.approx(special.logsumexp(alone) - np.log(3.0))
    assert found.any_cause == pytest.approx(np.logaddexp(*found.causes.values()))
    moved = found.gained({"wave": 2.0})
    assert moved.causes["wave"] == found.causes["wave"] + 2.0 and moved.causes["step"] == found.causes["step"]


def test_many_causes_are_mixed_and_few_are_not():
    """A mixture of few is hardly more than a pair, which could never be more probable than that."""
    rng = np.random.default_rng(4)
    x = np.linspace(0.0, 1.0, 60)
    fitted, family = np.ones((60, 1)), noise_family((series("time", [0] * 60, x),), x)[:1]
    causes = [Alternative(f"cause {k}", rng.standard_normal((60, 1))) for k in range(FEWEST_MIXED)]
    basis = independent(fitted)
    effects = np.column_stack([project_out(one.directions, basis) for one in causes])
    effects /= np.linalg.norm(effects, axis=0)
    several = 4.0 * effects @ rng.choice([-1.0, 1.0], FEWEST_MIXED) + rng.standard_normal(60)
    found = weighed(several, fitted, causes, [], family)
    assert set(found.corrections) == {MIXTURE} and found.any_correction > found.any_cause + 3.0
    alone = weighed(10.0 * effects[:, 0] + rng.standard_normal(60), fitted, causes, [], family)
    assert alone.any_correction < alone.any_cause - 3.0
    # How long the derivative of a cause is says nothing of how much of it there is.
    longer = [dataclasses.replace(causes[0], directions=1e3 * causes[0].directions), *causes[1:]]
    assert weighed(several, fitted, longer, [], family).corrections == pytest.approx(found.corrections)
    # Nor is a cause believed in more for its shapes.
    shapes = [dataclasses.replace(causes[0], shape=shape) for shape in (1.0, 2.0)]
    assert weighed(several, fitted, [*shapes, *causes[1:]], [], family).corrections == pytest.approx(found.corrections)
    assert weighed(several, fitted, causes[1:], [], family).corrections == {}


def test_odds_are_of_what_was_weighed():
    null = Weighed({"a": 3.0, "b": 1.0}, {"smooth": 0.0, "local": -1.0}, -4.0)
    left = Weighed({"b": 2.5}, {"smooth": 1.0}, 0.5)
    found = odds(null, "a", left)
    any_cause, any_correction = np.logaddexp(3.0, 1.0), np.logaddexp(0.0, -1.0)
    assert found.instead == pytest.approx(any_correction - any_cause)
    assert found.beside == pytest.approx(3.0 + (1.0 - 0.5) - any_cause)
    assert found.evidence == pytest.approx(any_cause + 4.0)
    pair = odds_of_pair(null, "a", left, "a", left, "b")
    assert pair == pytest.approx(np.logaddexp(any_correction, 3.5) - (3.0 + 2.5 - 0.5))
    # Without a fit of any cause, without any cause at all, and without anything.
    assert odds(null, "", None).beside == -np.inf and odds(null, "", None).instead == found.instead
    nobody = odds(dataclasses.replace(null, causes={}), "", None)
    assert nobody.instead == np.inf and nobody.evidence == pytest.approx(any_correction + 4.0)
    assert NO_ODDS.instead == NO_ODDS.beside == -np.inf
