"""How large noise is beside an effect: what the priors of the constants are weighed against."""

import dataclasses

import numpy as np
import pytest

from inverse.diagnosis import HMI_CAUSES
from inverse.diagnosis.hmi import diagnosis as hmi_diagnosis
from inverse.diagnosis.hmi.diagnosis import diagnose_curves
from inverse.diagnosis.hmi.noise_size import noise_size, size_beside_effect
from inverse.diagnosis.hmi.refit import again_from, fit_hmi
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative
from tests.inverse.diagnosis.hmi.cases import measured_with, white

NOISE = 0.005
DRIFT = "output-drift"


def fitted_in_its_own_noise(problem, name, strength, **given):
    """Without causes, as the diagnosis fits: priors weighed against the residuals as they are."""
    hidden, _ = measured_with(problem, name, strength, noise=NOISE, **given)
    fit = fit_hmi(hidden, (), white(hidden), size=NOISE)
    size = noise_size(fit)
    fit = again_from(fit, white(hidden), size)
    effects = hidden.alternatives(fit.unknowns, fit.directions, noise_size(fit))
    return fit, effects, size


def beside(fit, effects, size):
    return size_beside_effect(fit.residuals, fit.directions, fit.problem.noise_family(), effects, size)


@pytest.mark.parametrize("seed", [4, 5, 6])  # the level of 1 % was chosen on 1 to 3
def test_noise_alone_is_as_large_as_its_residuals(problem, seed):
    fit, effects, size = fitted_in_its_own_noise(problem, None, 0.0, seed=seed)
    # Priors are weighed by turns with it: what changes is less than a turn.
    assert beside(fit, effects, size) == pytest.approx(size, rel=0.02)
    # Of some twenty readings to spare, four standard errors.
    assert size == pytest.approx(NOISE, rel=4.0 / np.sqrt(2.0 * fit.freedom))


def test_correlated_noise_is_no_effect():
    """Of 100 draws of noise alone one in a hundred may pass; white noise alone asked, correlated noise passes often."""
    count = 40
    position, rng = np.linspace(0.0, 1.0, count), np.random.default_rng(8)
    directions = np.append(np.ones((count, 1)), [[0.0]], axis=0)
    directions = np.append(directions, np.append(position, 1.0)[:, None], axis=1)
    waves = [np.append(np.cos(np.pi * k * position), 0.0)[:, None] for k in range(2, 10)]
    effects = [Alternative(f"wave-{number}", wave) for number, wave in enumerate(waves)]
    family = [one.extended(1) for one in noise_family((series("time", [0] * count, position),), 37.0 + 40.0 * position)]
    found = {"all": 0, "white": 0}
    for _ in range(100):
        drawn = rng.standard_normal(count + 1)
        for row in range(1, count):
            drawn[row] = 0.8 * drawn[row - 1] + 0.6 * drawn[row]
        for name, asked in (("all", family), ("white", family[:1])):
            alone = size_beside_effect(drawn, directions, asked, (), 2.0)
            found[name] += size_beside_effect(drawn, directions, asked, effects, 2.0) < 0.98 * alone
    # Nine or more of 1 % have a probability of 1e-5, of 3 % (few data tell the noise badly) of 4e-3.
    assert found["all"] <= 8 and found["white"] >= 20


@pytest.mark.parametrize("strength", [1.0, 1.5])
def test_an_effect_is_no_noise(problem, strength):
    fit, effects, size = fitted_in_its_own_noise(problem, DRIFT, strength, seed=2)
    found = beside(fit, effects, size)
    assert size > 1.3 * NOISE and found == pytest.approx(NOISE, rel=4.0 / np.sqrt(2.0 * fit.freedom))


def test_of_an_effect_so_large_that_it_bends_the_bend_is_left(problem):
    fit, effects, size = fitted_in_its_own_noise(problem, DRIFT, 6.0, seed=2)
    assert size > 5.0 * NOISE and NOISE < beside(fit, effects, size) < 0.5 * size


def test_an_effect_of_the_other_sign_takes_nothing(problem):
    fit, effects, size = fitted_in_its_own_noise(problem, DRIFT, 6.0, seed=2)
    others = [one for one in effects if one.name == DRIFT and one.sign < 0]
    assert others and beside(fit, others, size) == size


def test_priors_follow_the_size_that_is_found(problem):
    """The fit weighed against it has the noise that was foretold in the linearised model."""
    fit, effects, size = fitted_in_its_own_noise(problem, DRIFT, 3.0, seed=2)
    found = beside(fit, effects, size)
    again = again_from(fit, white(fit.problem), found)
    effects = again.problem.alternatives(again.unknowns, again.directions, noise_size(again))
    # Twice the noise moves constants little here; a second fit finds it within its own turns.
    assert beside(again, effects, found) == pytest.approx(found, rel=0.1)


def test_without_effects_to_look_for_the_size_is_that_of_the_residuals(problem):
    fit, _, size = fitted_in_its_own_noise(problem, DRIFT, 3.0, seed=2)
    assert beside(fit, (), size) == pytest.approx(size, rel=0.02)


@pytest.mark.parametrize("library", [(DRIFT, "perfusion"), ("perfusion",)])
def test_a_diagnosis_weighs_priors_against_it_and_looks_in_its_library_alone(problem, library, monkeypatch):
    """A cause that is not looked for makes no noise smaller, though the simulation could have it."""
    asked = {}

    def examined(causes, null, rng, *, size, **_):
        asked.update(size=size, null=null)
        raise StopIteration

    monkeypatch.setattr(hmi_diagnosis, "examine_hmi", examined)
    hidden, _ = measured_with(problem, DRIFT, 3.0, noise=NOISE, seed=2)
    causes = [one for one in HMI_CAUSES if one.name in library]
    with pytest.raises(StopIteration):
        diagnose_curves(hidden, corrected=False, causes=causes, gain=False)
    null, size = asked["null"], asked["size"]
    believed = null.residuals[len(null.of_readings) :]
    np.testing.assert_allclose(believed, -size * hidden.program.penalties(null.unknowns), rtol=1e-12)
    assert (size < 0.6 * noise_size(null)) == (DRIFT in library)


def test_stated_noise_is_believed(problem, monkeypatch):
    asked = []
    monkeypatch.setattr(hmi_diagnosis, "examine_hmi", lambda *_, size, **__: asked.append(size) or 1 / 0)
    hidden, _ = measured_with(problem, DRIFT, 3.0, noise=NOISE, seed=2)
    stated = dataclasses.replace(hidden.rows, deviation=np.full(len(hidden.rows), NOISE))
    with pytest.raises(ZeroDivisionError):
        diagnose_curves(dataclasses.replace(hidden, rows=stated), corrected=False, gain=False)
    assert asked == [1.0]
