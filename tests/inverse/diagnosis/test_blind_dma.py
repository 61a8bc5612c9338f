"""Effects hidden by a generator that the diagnosis cannot see into: it gets the file, the key is opened after."""

import json

import numpy as np
import pytest

import inverse
from inverse.commands.main import run
from inverse.datasets.dma import dma_data, read_dma
from inverse.diagnosis import DMA_CAUSES, diagnose_dma
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind

TESTABLE = blind.shown()


def diagnosed(folder, *, seed, gain=False, model=FRACTIONAL, causes=DMA_CAUSES, **hidden):
    hidden["conventional"] = model == CONVENTIONAL
    blind.write(folder / "data.csv", folder / "key.json", seed=blind.TEST_SEEDS + seed, **hidden)
    found = diagnose_dma(read_dma(folder / "data.csv"), model=model, causes=causes, seed=seed, gain=gain)
    return found, json.loads((folder / "key.json").read_text())


def commanded(folder, *, seed, **hidden):
    """What the command writes of the file alone, and the key, opened afterwards."""
    data, key, out = folder / "data.csv", folder / "key.json", folder / "out"
    blind.write(data, key, seed=blind.TEST_SEEDS + seed, **hidden)
    assert run(["diagnose", "--dma", str(data), "--out", str(out), "--seed", str(seed)]) == 0
    return json.loads((out / "diagnosis.json").read_text()), json.loads(key.read_text())


def not_ruled_out(found, name):
    return found.decision is not None and name in found.decision.possible


@pytest.mark.slow
@pytest.mark.parametrize("name", TESTABLE)
def test_a_strong_effect_is_found_and_its_strength_is_covered(tmp_path, name):
    """At d' = 9 detection is certain; the rest holds in 95 or 99 of 100 data sets, and so in one of two nearly always.

    Noise and constants are drawn anew for every cause: with one seed for all, one unlucky draw (the right cause is
    called unexplained in 5 of 100) would fail all of them together.
    """
    found, covered = [], []
    for number in (1, 2):
        folder = tmp_path / str(number)
        folder.mkdir()
        one, key = commanded(folder, seed=100 * (1 + TESTABLE.index(name)) + number, name=name, d_prime=9.0)
        assert one["verdict"] in ("named", "confusable", "unexplained")
        own = next(cause for cause in one["causes"] if cause["name"] == name)
        found.append(own["status"] in ("named", "confusable"))
        hidden, interval = key["strength_of_readings"], own["interval"]
        covered.append(interval[0] <= hidden <= interval[1])
        if own["shape"] is None:
            # At d' = 9 the standard error is a ninth of the strength.
            assert own["estimate"] == pytest.approx(hidden, rel=5.0 / 9.0)
    assert any(found) and any(covered)


@pytest.mark.slow
def test_viscosity_of_the_bath_comes_first(tmp_path):
    """Few causes have an effect like it."""
    found, key = diagnosed(tmp_path, seed=1, name="bath-viscosity", d_prime=9.0)
    assert not_ruled_out(found, key["hidden"]) and found.causes[0].cause.name == "bath-viscosity"
    assert found.causes[0].estimate == pytest.approx(key["strength"], rel=0.5)


def test_of_a_conventional_solid_nothing_is_found_by_the_conventional_model(tmp_path):
    """Four data sets at level 5 %: three or more false alarms have a probability of 5e-4."""
    found = [diagnosed(tmp_path, seed=7100 + n, model=CONVENTIONAL)[0] for n in range(4)]
    assert sum(one.verdict in ("adequate", "noise-model") for one in found) >= 2


@pytest.mark.parametrize(
    "noise",
    [
        "white",
        *(
            pytest.param(kind, marks=pytest.mark.slow)
            for kind in ("tails", "correlated-0.3", "correlated-0.6", "loud", f"{blind.IN_TIME}-0.6")
        ),
    ],
)
def test_noise_of_no_kind_is_taken_for_an_effect(tmp_path, noise):
    """Six data sets at level 5 %: three or more false alarms have a probability of 2e-3, and of a half where the noise
    would be taken for an effect in half of them.
    """
    found = [diagnosed(tmp_path, seed=6000 + n, noise=noise)[0] for n in range(6)]
    assert sum(one.decision is None or one.decision.omnibus.p_value < 0.05 for one in found) <= 2


@pytest.mark.slow
def test_the_conventional_model_lacks_the_order_that_was_hidden(tmp_path):
    """Order 0.99 has a d' of 11 to 12 here, 0.98 was named in all of ten development sets. Of four at level 5 % two or
    more are called unexplained, and two or more intervals miss, with a probability of 1.4 % each.
    """
    hidden = {"name": "power-law-relaxation", "strength": 0.01}
    found = [diagnosed(tmp_path, seed=7200 + n, model=CONVENTIONAL, **hidden)[0] for n in range(4)]
    own = [next(c for c in one.causes if c.cause.name == "power-law-relaxation") for one in found]
    assert sum(one.status in ("named", "confusable") for one in own) >= 3
    assert sum(one.interval[0] <= 0.01 <= one.interval[1] for one in own) >= 3
    assert all(one.verdict not in ("adequate", "noise-model") for one in found)


@pytest.mark.parametrize(("rows", "phase"), [(7, True), (6, True), (9, False)])
def test_a_single_short_sweep_of_nothing_is_adequate(rows, phase):
    """Fewer data than the free forms have terms."""
    m = blind.draw_measurement(np.random.default_rng(4))
    noise = blind.draw_noise("white", m, np.random.default_rng(5))
    modulus = (blind.solid(m.constants, m.omega) * np.exp(blind.NOISE * noise))[2, :rows]
    values = np.stack([modulus.real, modulus.imag], axis=-1) if phase else np.abs(modulus)
    found = diagnose_dma(dma_data(m.frequency[:rows], np.full(rows, 50.0), values), gain=False)
    assert found.verdict == "adequate"
    assert all(np.isfinite(one.p_value) for one in found.causes)


def test_the_key_says_how_many_rows_of_negative_loss_were_left_out(tmp_path):
    data, key = tmp_path / "data.csv", tmp_path / "key.json"
    left_out = []
    for seed in range(8):
        blind.write(data, key, seed=seed, noise="loud")
        left_out.append(json.loads(key.read_text())["rows_left_out"])
        assert len(read_dma(data).frequency_hz) == 5 * 14 - left_out[-1]
    assert max(left_out) > 0


def test_a_level_that_is_too_low_is_refused():
    m = blind.draw_measurement(np.random.default_rng(4))
    modulus = np.abs(blind.solid(m.constants, m.omega))
    data = dma_data(np.tile(m.frequency, 5), np.repeat(m.temperature, 14), modulus.ravel())
    with pytest.raises(ValueError, match="`level` must be from 0.005"):
        diagnose_dma(data, level=0.001)


def test_a_compliant_clamp_is_hidden_cannot_be_seen_and_is_said_to_be(tmp_path):
    """A clamp as soft as a fifth of the stiffest sample. Level 5 %: three or more alarms in four have p = 5e-4."""
    stiffest = blind.draw_measurement(np.random.default_rng(1))
    compliance = 0.2 / float(np.abs(blind.solid(stiffest.constants, stiffest.omega)).max())
    found = [diagnosed(tmp_path, seed=3 + n, name="clamp-compliance", strength=compliance)[0] for n in range(4)]
    assert sum(one.verdict in ("adequate", "noise-model") for one in found) >= 2
    for one in found:
        hidden = {cause.name: cause for cause in one.not_testable}
        assert "half the thickness" in hidden["clamp-compliance"].what_would_help
        assert "imitate" in hidden["clamp-compliance"].why


@pytest.mark.slow
@pytest.mark.parametrize("name", list(blind.UNKNOWN))
def test_an_effect_of_no_name_stays_without(tmp_path, name):
    """At d' = 12 more than nine of ten stay so; two that do not are less likely than one in a hundred."""
    seeds = (3000 + 100 * list(blind.UNKNOWN).index(name) + number for number in (1, 2))
    found = [diagnosed(tmp_path, seed=seed, name=name, d_prime=12.0)[0] for seed in seeds]
    assert all(one.verdict != "adequate" for one in found)
    assert any(one.verdict == "unexplained" and not one.named for one in found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["frame-resonance", "instrument-inertia", "slip"])
def test_a_cause_that_is_taken_out_of_the_library_is_given_no_other_s_name(tmp_path, name):
    """Of these, which no other cause imitates, 84 to 96 of 100 are `unexplained` then: fewer than two of four have a
    probability of 1.4 % at most (docs/operating_characteristic.md has the others).
    """
    library = [cause for cause in DMA_CAUSES if cause.name != name]
    first = 8000 + 10 * TESTABLE.index(name)
    found = [diagnosed(tmp_path, seed=first + n, name=name, d_prime=9.0, causes=library)[0] for n in range(4)]
    assert all(one.verdict != "adequate" for one in found)
    assert sum(one.verdict == "unexplained" and not one.named for one in found) >= 2
    assert all(name not in {own.cause.name for own in one.causes} for one in found)


@pytest.mark.slow
@pytest.mark.parametrize(("other", "first"), [("instrument-inertia", 4001), ("phase-delay", 4041)])
def test_two_causes_at_once(tmp_path, other, first):
    """Drying and drift of the reading resemble each other (.85), a delay and drainage: sets, beside what stands out.

    A delay is counted in units that are 1e-4 of what is plausible: a second cause starts in its own. One true pair in
    ten is called unexplained, by the level that pairs are held to. Measured on seeds for development: 11 of 12 pairs
    with a delay complete; fewer than four of six at such a rate are less likely than one in a hundred. (Of 4021 to
    4026, which were looked at before six were asked for, four were.)
    """
    complete = []
    for seed in range(first, first + 6):
        found, _ = diagnosed(tmp_path, seed=seed, name=f"drying+{other}", d_prime=8.0)
        mentioned = {*found.named, *(name for names in found.confusable for name in names)}
        complete.append({"drying", other} <= mentioned)
        if other == "instrument-inertia":
            complete[-1] &= other in found.named
        if complete[-1]:
            assert found.extended is not None and len(found.extended.extensions) == 2
            assert found.verdict == ("confusable" if found.confusable else "named")
    assert sum(complete) >= 4


def test_strange_noise_is_called_noise(tmp_path):
    """Whatever else is found (nothing, in 19 of 20), the gate says so; four sets, of which one may be overlooked."""
    for noise in ("correlated-0.6", "loud"):
        found = [diagnosed(tmp_path, seed=20 + seed, noise=noise)[0] for seed in range(4)]
        assert sum(one.noise is not None and not one.noise.as_thought for one in found) >= 3
        assert sum(one.verdict == "noise-model" for one in found) >= 2


def test_deviations_stated_too_small_are_noise_and_no_physics(tmp_path):
    """By 1.3: with the stated size taken for true, two of three sets without anything in them would be found wrong."""
    found = [diagnosed(tmp_path, seed=seed, noise="understated")[0] for seed in range(30, 34)]
    # At level 5 % two or more of four have a probability of 1.4 %.
    assert sum(one.decision is not None and one.decision.omnibus.p_value < 0.05 for one in found) <= 1
    assert sum(one.verdict == "noise-model" for one in found) >= 2
    for one in found:
        # 120 degrees of freedom: four standard errors of a standard deviation are a quarter of it.
        assert one.noise is not None and one.noise.size == pytest.approx(1.3, rel=0.26)


@pytest.mark.slow
def test_drift_and_drying_are_one_set_where_they_cannot_be_told_apart(tmp_path):
    """Their effects have a cosine of .85: at d' = 4.5 the wrong one is 2.4 from the data, and ruled out from 2.6 on."""
    sets = [diagnosed(tmp_path, seed=4100 + n, name="drying", d_prime=4.5)[0] for n in range(6)]
    together = [{"drying", "sweep-drift"} <= {name for names in one.confusable for name in names} for one in sets]
    # In each with a probability of about a half: in none of six, 1 %; found and kept are 93 and 99 of 100.
    assert sum(together) >= 1
    assert sum(not_ruled_out(one, "drying") for one in sets) >= 4
    assert sum(one.named == ("sweep-drift",) for one in sets) <= 1
    for seed in (4100 + n for n, both in enumerate(together) if both):
        file = tmp_path / f"{seed}.csv"
        blind.write(file, tmp_path / "key.json", seed=blind.TEST_SEEDS + seed, name="drying", d_prime=4.5)
        again = inverse.diagnose(file, out=tmp_path / "out", gain=False, seed=seed)
        (apart,) = again.content["separation"]
        assert apart["causes"] == again.content["confusable"][0]
        # Drift starts anew with every sweep and drying does not: another order of the same readings shows it.
        assert apart["measurement"]["angle_deg"] > apart["angle_deg"]
        assert apart["measurement"]["probability_right"] > apart["probability_right"]
        words = (tmp_path / "out" / "report.md").read_text()
        assert "To tell it from the others" in words and f"{apart['measurement']['words']} separates them best" in words


@pytest.mark.slow
def test_gain_is_measured_on_frequencies_left_out(tmp_path):
    """On the first of three data sets that is not among the 5 in 100 of which the right cause is not accepted."""
    sets = (diagnosed(tmp_path, seed=seed, name="bath-viscosity", d_prime=15.0, gain=True)[0] for seed in (7, 8, 9))
    found = next(one for one in sets if one.verdict != "unexplained")
    assert found.gain is not None and found.gain.rmse_after < found.gain.rmse_before
    assert found.gain.log_score_gain > 0.0 and found.gain.unfinished == 0
    # What is left is the noise, and the little that the constants of the folds are off.
    assert found.gain.rmse_after == pytest.approx(blind.NOISE, rel=0.6)


@pytest.mark.slow
def test_same_seed_same_answer(tmp_path):
    first, second = (diagnosed(tmp_path, seed=8, name="slip", d_prime=6.0)[0] for _ in range(2))
    assert first.verdict == second.verdict
    np.testing.assert_array_equal([c.p_value for c in first.causes], [c.p_value for c in second.causes])
