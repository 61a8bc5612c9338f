"""From tests to a verdict, on linear data."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from arfjax import InputError
from inverse.diagnosis.decision import NEEDED, PAIR_LEVEL, Refitted, decide
from inverse.diagnosis.diagnosis import _status
from inverse.diagnosis.evidence import ALLOWANCE, evidence
from inverse.diagnosis.free_forms import Place
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.odds import Odds
from inverse.diagnosis.rule import MOST_BESIDE, MOST_INSTEAD, MOST_OF_PAIR, SET_LEVEL, UNEXPLAINED_LEVEL, enough
from inverse.diagnosis.screening import Alternative, Screen
from inverse.diagnosis.where import absorbed_by_places

N = 80
POSITION = np.linspace(0.0, 1.0, N)
FITTED = np.column_stack([np.ones(N), POSITION])
CAUSES = [
    Alternative("wave", np.sin(9.0 * POSITION)[:, None]),
    Alternative("step", (POSITION > 0.5).astype(float)[:, None]),
    Alternative("bend", (POSITION**2)[:, None]),
]
FAMILY = noise_family((series("time", [0] * N, POSITION),), POSITION)[:1]


def hidden(*effects, seed=3):
    return sum(effects) + np.random.default_rng(seed).standard_normal(N)


def decided(residuals, extend=None):
    return decide(residuals, FITTED, CAUSES, [], FAMILY, np.random.default_rng(1), extend=extend)


def projected(added):
    """The fit with causes in it, which is exact where everything is linear."""
    data, moved = WAVE, np.concatenate([FITTED, *(one.directions for one in added)], axis=1)
    left = data - moved @ np.linalg.lstsq(moved, data)[0]
    return Refitted(left, moved, float(left @ left), CAUSES)


WAVE = hidden(1.5 * CAUSES[0].directions[:, 0])


def test_what_is_hidden_is_named():
    found = decided(WAVE, lambda added, _: projected(added))
    assert found.verdict == "named" and found.named == ("wave",)


def test_what_is_left_is_told_of_the_fit_that_was_tested():
    ripple = Alternative("ripple", np.cos(31.0 * POSITION)[:, None])
    found = decide(
        WAVE, FITTED, CAUSES, [ripple], FAMILY, np.random.default_rng(1), extend=lambda added, _: projected(added)
    )
    left = projected(CAUSES[:1]).residuals
    np.testing.assert_array_equal(found.last.residuals, left)
    (place,) = absorbed_by_places(found.last, [Place("ripple", "somewhere")])
    freed = np.linalg.qr(np.column_stack([FITTED, CAUSES[0].directions, ripple.directions]))[0]
    assert place.share == pytest.approx(1.0 - np.sum((left - freed @ (freed.T @ left)) ** 2) / np.sum(left**2))


def test_a_cause_that_is_looked_for_alone_is_put_in_though_hardly_found():
    """Of p = 0.03: of many causes one like that is nothing, of one alone it is what was found."""
    wave = CAUSES[0].directions[:, 0]
    basis = np.linalg.qr(np.column_stack([FITTED, wave]))[0]
    noise = np.random.default_rng(3).standard_normal(N)
    noise -= basis @ (basis.T @ noise)
    freedom = N - 3
    t = stats.t.isf(0.5 * 0.03, freedom)
    residuals = noise + t * np.linalg.norm(noise) / np.sqrt(freedom) * basis[:, 2]
    ripple = Alternative("ripple", np.cos(31.0 * POSITION)[:, None])
    found = decide(residuals, FITTED, CAUSES[:1], [ripple], FAMILY, np.random.default_rng(1))
    assert np.exp(found.omnibus.log_p[0]) == pytest.approx(0.03, rel=1e-6)
    assert found.verdict == "named" and found.named == ("wave",)


@pytest.mark.parametrize("failing", ["wave", "step"])
def test_a_refit_that_did_not_converge_explains_nothing(failing):
    """Nor does it rule its cause out: what it leaves is what any point on the way would leave."""

    def extend(added, _):
        return dataclasses.replace(projected(added), converged=failing not in [one.name for one in added])

    found = decided(WAVE, extend)
    if failing == "wave":
        assert found.verdict == "unexplained" and found.named == () == found.confusable
        assert "wave" in found.possible and found.candidates["wave"] > UNEXPLAINED_LEVEL
    else:
        assert found.verdict == "named" and found.named == ("wave",)


def beside_a_wave(cosine, seed=5):
    """A unit direction at an angle to that of the cause and free of what is fitted, and noise that is free of both."""
    basis = np.linalg.qr(np.column_stack([FITTED, CAUSES[0].directions, np.cos(23.0 * POSITION)]))[0]
    wave = basis[:, 2] * np.sign(basis[:, 2] @ CAUSES[0].directions[:, 0])
    noise = np.random.default_rng(seed).standard_normal(N)
    return cosine * wave + np.sqrt(1.0 - cosine**2) * basis[:, 3], wave, noise - basis @ (basis.T @ noise)


def decided_beside_a_free_form(residuals, form, extend=None, *, few=False):
    """As many free forms as causes, so that both pay alike for their number."""
    others = [Alternative(f"ripple of {k:.0f}", np.cos(k * POSITION)[:, None]) for k in (31.0, 47.0)]
    forms = [Alternative("ripple", form[:, None]), *others]
    return decide(residuals, FITTED, CAUSES, forms, FAMILY, np.random.default_rng(1), extend=extend, few=few)


NEAR = np.sqrt(1.0 - 0.25**2)
"""Cosine at which the cause leaves a quarter."""


def test_what_looks_more_like_a_free_form_than_like_any_cause_has_no_name():
    """The cause nearest to it leaves two standard deviations of it, which is nothing conspicuous."""
    ripple, _, noise = beside_a_wave(NEAR)
    found = decided_beside_a_free_form(8.0 * ripple + noise, ripple)
    assert found.candidates["wave"] > UNEXPLAINED_LEVEL
    assert found.odds.instead > MOST_INSTEAD and found.odds.beside < MOST_BESIDE
    assert found.verdict == "unexplained" and found.named == () == found.confusable
    assert found.possible == ("wave",) and found.last is found.omnibus


def test_an_effect_that_is_a_cause_s_is_named_though_a_free_form_resembles_it():
    ripple, wave, noise = beside_a_wave(NEAR)
    found = decided_beside_a_free_form(8.0 * wave + noise, ripple)
    assert found.omnibus.p_family[found.omnibus.free][0] < 0.05
    assert found.odds.instead < 0.0 and found.named == ("wave",)


def test_a_large_effect_that_bends_away_from_its_direction_is_named():
    """Its refit follows it, and says so; the direction about the null model alone falls behind the free form."""
    ripple, _, noise = beside_a_wave(0.9)
    data = 30.0 * ripple + noise

    def extend(added, _):
        moved = np.concatenate([FITTED, *(one.directions for one in added)], axis=1)
        left = data - moved @ np.linalg.lstsq(moved, data)[0]
        if added[0].name == "wave":
            left, moved = noise, np.column_stack([FITTED, ripple])
        return Refitted(left, moved, float(left @ left), CAUSES)

    found = decided_beside_a_free_form(data, ripple, extend)
    # The refit takes what the free form does, and of its kind there is one.
    assert found.odds.instead < 0.0 and found.verdict == "named" and found.named == ("wave",)
    lost = decided_beside_a_free_form(
        data, ripple, lambda added, noise: dataclasses.replace(extend(added, noise), converged=False)
    )
    assert lost.odds.instead > 10.0 and lost.odds.beside == -np.inf and lost.verdict == "unexplained"


def test_a_refit_that_is_the_worse_fit_takes_nothing_from_its_cause():
    ripple, wave, noise = beside_a_wave(NEAR)

    def extend(added, _):
        return dataclasses.replace(projected(added), misfit=1e6)

    found = decided_beside_a_free_form(8.0 * wave + noise, ripple, extend)
    assert found.odds.instead == decided_beside_a_free_form(8.0 * wave + noise, ripple).odds.instead


def test_a_free_form_has_to_be_more_improbable_than_a_cause():
    """In the data alone that would be a penalty of replicates, and in these alone a gift."""
    ripple, _, noise = beside_a_wave(NEAR)
    screen = Screen(FITTED, [*CAUSES, Alternative("ripple", ripple[:, None])], FAMILY)
    free = np.array([one.name == "ripple" for one in screen.alternatives])
    alike, behind = (
        evidence(screen, 3.0 * ripple + noise, np.random.default_rng(1), free, handicap, 400)
        for handicap in (1.0, 10.0)
    )
    assert np.all(behind.p_family[free] > alike.p_family[free])
    # Replicates have it, too: to causes free forms of noise alone count for less.
    wave = [one.name for one in screen.alternatives].index("wave")
    assert behind.p_family[wave] < alike.p_family[wave]
    # All of noise alone: where nothing is hidden one of twenty is as improbable, whatever the handicap.
    nothing = [
        evidence(screen, drawn, np.random.default_rng(1), free, 10.0, 100).p_value
        for drawn in np.random.default_rng(8).standard_normal((100, N))
    ]
    assert 0 < np.sum(np.array(nothing) <= 0.05) <= 12


@pytest.mark.parametrize("averaged", [False, True])
@pytest.mark.parametrize("causes", [CAUSES, []])
def test_replicates_have_the_noise_that_goes_with_the_likeliest_cause(causes, averaged):
    """A smooth effect looks like correlated noise to who leaves it out, and correlated noise hides smooth effects."""
    family = noise_family((series("time", [0] * N, POSITION),), POSITION)
    smooth = Alternative("smooth", np.cos(np.pi * np.arange(8) * POSITION[:, None]))
    drawn = []

    class Spied(Screen):
        def replicate(self, residuals, weights, count, rng):
            drawn.append(weights)
            return super().replicate(residuals, weights, count, rng)

    screen = Spied(FITTED, [*causes, smooth], family)
    free = np.array([one is smooth for one in screen.alternatives])
    found = evidence(screen, WAVE, np.random.default_rng(1), free, 1.0, 20, averaged=averaged)
    assert family[found.null_noise].correlation > 0.0
    correlated = np.array([one.correlation > 0.0 for one in family])
    assert drawn and all((np.sum(weights[correlated]) < 0.5) == bool(causes) for weights in drawn)
    best = found.best("wave")
    expected = screen.noise_weights(WAVE, best)
    if not averaged:
        expected = np.eye(len(family))[found.null_noise if best is None else found.noises[best]]
    np.testing.assert_array_equal(drawn[0], expected)


def test_not_to_know_the_noise_costs_an_allowance():
    """Where there is but one kind, averaged or not is the same, so that p-values show nothing else."""
    screen = Screen(FITTED, CAUSES, FAMILY)
    free = np.zeros(len(CAUSES), dtype=bool)
    for residuals in (WAVE, hidden(seed=11)):
        likeliest, averaged = (
            evidence(screen, residuals, np.random.default_rng(1), free, 1.0, 100, averaged=one) for one in (False, True)
        )
        np.testing.assert_allclose(averaged.p_family, np.minimum(ALLOWANCE * likeliest.p_family, 1.0), rtol=1e-12)
        assert averaged.least_p == pytest.approx(ALLOWANCE * likeliest.least_p, rel=1e-12)
        assert averaged.least_p <= averaged.p_value


def test_a_cause_for_which_nothing_speaks_is_not_put_in():
    """Something is found, and it is nothing that the one that is looked for would do."""
    ripple, _, noise = beside_a_wave(0.0)
    form = Alternative("ripple", ripple[:, None])
    found = decide(8.0 * ripple + noise, FITTED, CAUSES[:1], [form], FAMILY, np.random.default_rng(1))
    assert np.exp(found.omnibus.log_p[0]) > 0.05
    assert found.verdict == "unexplained" and found.candidates == {} and found.possible == ()


def test_noise_is_averaged_only_where_everything_is_tested(monkeypatch):
    """What a cause leaves would look like noise of some kind too often."""
    kinds, replicate = [], Screen.replicate

    def spied(self, residuals, weights, count, rng):
        kinds.append(np.count_nonzero(weights))
        return replicate(self, residuals, weights, count, rng)

    monkeypatch.setattr(Screen, "replicate", spied)
    family = noise_family((series("time", [0] * N, POSITION),), POSITION)
    for few in (False, True):
        kinds.clear()
        found = decide(WAVE, FITTED, CAUSES, [], family, np.random.default_rng(1), few=few)
        assert found.named == ("wave",) and (kinds[0] > 1) == few
        assert len(kinds) > 1 and set(kinds[1:]) == {1}


def test_one_cause_is_enough_up_to_both_limits():
    assert enough(Odds(MOST_INSTEAD, MOST_BESIDE, 9.0)) and enough(Odds(-np.inf, -np.inf, 0.0))
    assert not enough(Odds(MOST_INSTEAD + 1e-9, -np.inf, 9.0)) and not enough(Odds(-np.inf, MOST_BESIDE + 1e-9, 9.0))


def test_what_a_cause_leaves_is_told_from_noise_by_what_it_is_like():
    """The ripple is beside the cause, far from conspicuous among all that is tried, and like nothing but a ripple."""
    ripple, wave, noise = beside_a_wave(0.0)
    data = 10.0 * wave + 4.2 * ripple + noise
    alone, both = decided(data), decided_beside_a_free_form(data, ripple)
    assert alone.named == ("wave",) and alone.odds.beside < 1.0
    assert both.odds.beside > MOST_BESIDE and both.odds.instead < -10.0 and both.verdict == "unexplained"


def test_of_few_data_the_best_fit_that_converged_speaks():
    """One that did not may have the least misfit on its way."""

    def extend(added, _):
        better = dataclasses.replace(projected(added), misfit=1e-6, converged=False)
        return better if added[0].name == "bend" else projected(added)

    found = decide(WAVE, FITTED, CAUSES, [], FAMILY, np.random.default_rng(1), extend=extend, few=True)
    assert next(iter(found.tests)) == "bend" and found.best_fit == "wave" and found.named == ("wave",)


def test_a_refit_that_did_not_converge_rules_no_cause_out():
    """Where it stopped everything may be left."""

    def extend(added, _):
        lost = Refitted(WAVE, FITTED, float(WAVE @ WAVE), CAUSES, converged=False)
        return lost if added[0].name == "bend" else projected(added)

    found = decided(WAVE, extend)
    assert found.named == ("wave",) and found.candidates["bend"] < SET_LEVEL
    assert found.unsettled == ("bend",) and found.possible == ("wave", "bend")


def far_above_noise(seed=3):
    """Three like each other, of which the last one is there, so strongly that no float holds the p-value of any."""
    x = np.linspace(0.0, 1.0, 600)
    names = {"alike": x**1.9, "between": x**2.2, "true": x**2}
    causes = [Alternative(name, column[:, None]) for name, column in names.items()]
    ripple = Alternative("ripple", np.stack([np.cos(k * np.pi * x) for k in range(1, 7)], axis=-1))
    data = 40.0 * x**2 + 0.02 * np.random.default_rng(seed).standard_normal(len(x))
    fitted = np.column_stack([np.ones_like(x), x])
    family = noise_family((series("time", [0] * len(x), x),), x)[:1]
    return decide(data, fitted, causes, [ripple], family, np.random.default_rng(1))


def test_effects_far_above_the_noise_have_an_order_and_odds():
    found = far_above_noise()
    assert np.all(np.isfinite(found.omnibus.log_p)) and np.min(found.omnibus.log_p) < -1000.0
    assert found.omnibus.ranked(["alike", "between", "true"])[0] == "true"
    assert found.odds.instead < 0.0 and found.named == ("true",)


def test_what_leaves_no_data_explains_nothing():
    """Ten data and seven constants: two causes leave one datum, whatever that is."""
    count = 10
    x = np.linspace(0.0, 1.0, count)
    fitted = np.stack([np.cos(k * np.pi * x) for k in range(7)], axis=-1)
    waves = {name: np.sin((k + 8.3) * 2.1 * x) for k, name in enumerate(("one", "two"))}
    causes = [Alternative(name, column[:, None]) for name, column in waves.items()]
    family = noise_family((series("time", [0] * count, x),), x)[:1]
    rng = np.random.default_rng(2)
    for _ in range(20):
        data = 1e3 * rng.standard_normal() * waves["one"] + 1e3 * rng.standard_normal() * waves["two"]
        data += rng.standard_normal(count)
        found = decide(data, fitted, causes, [], family, np.random.default_rng(1))
        assert all(len(names) < 2 for names in found.explanations)


def test_nothing_else_to_look_for_is_nothing_conspicuous():
    """One cause alone in the list, and no correction of no name."""
    found = decide(WAVE, FITTED, CAUSES[:1], [], FAMILY, np.random.default_rng(1))
    assert found.verdict == "named" and found.candidates == {"wave": 1.0}


@pytest.mark.parametrize("local", [False, True])
def test_a_cause_must_not_have_the_name_of_a_free_form(local):
    ripple = Alternative("wave", np.cos(31.0 * POSITION)[:, None])
    forms = {"free_forms": [] if local else [ripple], "local_forms": [ripple] if local else []}
    with pytest.raises(InputError, match="the cause wave has the name of a correction"):
        decide(WAVE, FITTED, CAUSES, family=FAMILY, rng=np.random.default_rng(1), **forms)


def test_a_weaker_second_cause_does_not_hide_the_next():
    """One-sided, it is the more improbable with less of a t than a pair asks for: the next one has enough."""
    waves = np.stack([np.sin(k * POSITION) for k in (9.0, 20.0, 31.0)], axis=-1)
    basis = np.linalg.qr(np.column_stack([FITTED, waves]))[0]
    noise = np.random.default_rng(3).standard_normal(N)
    noise -= basis @ (basis.T @ noise)
    unit = basis[:, 2:]
    signs = {"a": 0, "b": 1, "c": 0}
    causes = [Alternative(name, unit[:, [k]], sign=sign) for k, (name, sign) in enumerate(signs.items())]
    # t^2 = a^2 (N - 4) / (what the noise and the other one leave), for both.
    share = np.array([NEEDED - 0.04, NEEDED + 0.03]) ** 2 / (N - 4)
    squares = np.linalg.solve(np.array([[1.0, -share[0]], [-share[1], 1.0]]), share * (noise @ noise))
    data = noise + unit @ np.array([30.0, *np.sqrt(squares)])
    test = Screen(np.column_stack([FITTED, unit[:, 0]]), causes[1:], FAMILY).statistics(data[:, None])
    np.testing.assert_allclose(test.statistic[:, 0], [NEEDED - 0.04, NEEDED + 0.03])
    assert test.log_p[0, 0] < test.log_p[1, 0]
    tried = []

    def extend(added, _):
        tried.append([one.name for one in added])
        moved = np.concatenate([FITTED, *(one.directions for one in added)], axis=1)
        rest = data - moved @ np.linalg.lstsq(moved, data)[0]
        return Refitted(rest, moved, float(rest @ rest), causes)

    decide(data, FITTED, causes, [], FAMILY, np.random.default_rng(1), extend=extend)
    assert ["a", "c"] in tried and ["a", "b"] not in tried


def two_at_once(t_of_the_rest):
    """A wave and a step, far above the noise, and a bend that leaves a certain t beside both."""
    basis = np.linalg.qr(np.column_stack([FITTED, *(one.directions for one in CAUSES)]))[0]
    noise = np.random.default_rng(6).standard_normal(N)
    noise -= basis @ (basis.T @ noise)
    left = t_of_the_rest * np.linalg.norm(noise) / np.sqrt(N - 5)
    return noise + basis[:, 2:] @ np.array([15.0, 12.0, left])


def test_two_causes_at_once_are_named_together():
    """Neither does alone, and beside both nothing is left."""
    found = decided(two_at_once(0.5))
    assert found.verdict == "named" and found.explanations == (("step", "wave"),)
    assert set(found.named) == {"wave", "step"} and found.confusable == ()
    assert max(found.candidates.values()) <= SET_LEVEL and found.last.p_value > PAIR_LEVEL
    # What the pair leaves is what is told of it.
    assert {one.name for one in found.last.alternatives} == {"bend"}


def test_two_causes_do_not_explain_what_is_more_like_a_correction_of_no_name():
    """The same data, where there is a correction that is both of them at once."""
    data = two_at_once(0.5)
    basis = np.linalg.qr(np.column_stack([FITTED, *(one.directions for one in CAUSES)]))[0]
    form = basis[:, 2:4] @ np.array([15.0, 12.0])
    found = decided_beside_a_free_form(data, form)
    assert max(found.candidates.values()) <= SET_LEVEL
    assert found.verdict == "unexplained" and found.explanations == () and found.odds.instead > 10.0 > MOST_OF_PAIR


def test_a_pair_explains_only_what_it_leaves_inconspicuous_at_a_level_of_its_own():
    """A rest of p = 0.04 would do for one cause, which is not one of many that are tried."""
    residuals = two_at_once(stats.t.isf(0.5 * 0.04, N - 5))
    both = decide(residuals, np.column_stack([FITTED, *(one.directions for one in CAUSES[:2])]), CAUSES[2:], [],
                  FAMILY, np.random.default_rng(1))  # fmt: skip
    assert SET_LEVEL < both.omnibus.p_value < PAIR_LEVEL
    found = decided(residuals)
    assert found.verdict == "unexplained" and found.named == () == found.confusable


def test_of_causes_that_cannot_be_told_apart_the_rest_of_the_best_fitting_one_is_told():
    """Half way between two waves, a little nearer to the second one of the list."""
    waves = [Alternative(name, np.sin(k * POSITION)[:, None]) for name, k in (("slow", 9.0), ("fast", 9.3))]
    columns = np.concatenate([one.directions for one in waves], axis=1)
    noise = np.random.default_rng(9).standard_normal(N)
    basis = np.linalg.qr(np.column_stack([FITTED, columns]))[0]
    data = noise - basis @ (basis.T @ noise) + 1.2 * columns @ np.array([0.45, 0.55])
    found = decide(data, FITTED, waves, [], FAMILY, np.random.default_rng(1))
    assert found.verdict == "confusable" and found.explanations == (("fast",), ("slow",))
    assert found.named == () and found.confusable == ("fast", "slow") and found.best_fit == "fast"
    assert found.last is found.tests["fast"]


@pytest.mark.parametrize("t", [1.5, 2.5])
def test_a_p_value_is_the_share_of_data_as_conspicuous_these_data_among_them(t):
    """Of one alternative, whose own p-values put replicates and data in the order of their t."""
    basis = np.linalg.qr(np.column_stack([FITTED, CAUSES[0].directions]))[0]
    noise = np.random.default_rng(3).standard_normal(N)
    noise -= basis @ (basis.T @ noise)
    residuals = noise + t * np.linalg.norm(noise) / np.sqrt(N - 3) * basis[:, 2]
    screen, free = Screen(FITTED, CAUSES[:1], FAMILY), np.zeros(1, dtype=bool)
    found = evidence(screen, residuals, np.random.default_rng(1), free, 1.0, 200)
    drawn = screen.replicate(residuals, np.ones(1), 200, np.random.default_rng(1))
    as_large = np.abs(screen.statistics(drawn).statistic[0]) >= t
    assert found.p_value == found.p_family[0] == pytest.approx((1.0 + np.sum(as_large)) / 201.0, rel=1e-12)
    assert 0.0 < np.sum(as_large) < 60.0 and found.least_p == pytest.approx(1.0 / 201.0)


def test_what_is_said_of_each_cause():
    """In every explanation, in some, in none but not ruled out, ruled out, and never put in; in that order."""
    candidates = {"worse": 0.02, "fits": 0.5, "other": 0.3, "out": 0.009, "lost": 0.001}
    found = dataclasses.replace(
        decided(WAVE), candidates=candidates, explanations=(("fits", "other"), ("fits",)), unsettled=("lost",)
    )
    assert found.named == ("fits",) and found.confusable == ("other",)
    assert found.possible == ("fits", "other", "worse", "lost")
    said = {name: _status(name, found) for name in (*candidates, "never")}
    assert said == {
        "fits": "named", "other": "confusable", "worse": "possible", "lost": "possible", "out": "ruled out",
        "never": "not needed",
    }  # fmt: skip
    # Those that were put in by their fits, the others by what speaks for them.
    assert found.ranked(["bend", "wave", "step"]) == [*candidates, *found.omnibus.ranked(["bend", "wave", "step"])]
    assert found.omnibus.ranked(["bend", "wave", "step"])[0] == "wave"
