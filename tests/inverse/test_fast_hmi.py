"""The fast model of HMI curves: near the full one, with its gradients, and silent nowhere outside its range."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import Effort, InputError, Square, discretise, read_experiment, stepwise_displacement
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.fast_hmi import FastHmi, Verification, prepare_fast
from inverse.hmi_fit import CalibrationSettings, constants_of
from inverse.hmi_model import plan_sweeps
from tests.checks import assert_gradient

DESCRIBED = read_experiment(shipped("suomi2016_experiment"))
MODEL = jax.tree.map(jnp.asarray, DESCRIBED.model())
CONSTANTS = constants_of(MODEL, CalibrationSettings())
SMALL = Effort(n_pushes=16, n_modes=24, n_terms=8, tolerance=2e-3, n_push_steps=10, n_heat_steps=30)


def model_at(z):
    return CONSTANTS.apply(MODEL, CONSTANTS.values(jnp.asarray(z, float)))


def draws(count, *, width=1.3, seed=0):
    """Draws of the prior that a calibration has, the first its centre."""
    rng, at = np.random.default_rng(seed), jax.jit(model_at)
    return [at(width * rng.normal(size=8) if number else np.zeros(8)) for number in range(count)]


def sweeps_of(temperatures):
    temperatures = np.asarray(temperatures)
    rows = len(temperatures)
    data = HmiData(Path("none"), ("1",) * rows, temperatures, None, np.full(rows, 100.0), True, None, ())
    return plan_sweeps(data, DESCRIBED.stepwise(), 37.0)


SWEEPS = sweeps_of([70.0, 45.0, 60.0])
ROWS = {"n_rows": 3, "in_percent": True}


@pytest.fixture(scope="module")
def settings():
    """Grids, mesh and steps that the small fast model shares with the full one that it is compared with."""
    coarse = discretise(MODEL, refinement=0.5)
    return dataclasses.replace(coarse, n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps)


@pytest.fixture(scope="module")
def fast(settings):
    return prepare_fast(draws(20), SWEEPS, settings, heat_settings=settings, effort=SMALL)


@pytest.fixture(scope="module")
def rows(fast):
    """Rows as a function of the calibration's unconstrained numbers."""
    return jax.jit(lambda z: fast.predict(model_at(z), **ROWS))


@pytest.fixture(scope="module")
def of_model(fast):
    """Rows, excess and indicator as a function of the model."""
    return jax.jit(lambda model: (fast.predict(model, **ROWS), fast.excess(model), fast.indicator(model)))


@pytest.mark.slow
def test_rows_are_near_those_of_the_full_model(fast, of_model, settings):
    models = draws(5, width=0.8, seed=5)
    checked = fast.verify(models, settings, **ROWS)
    assert np.all(checked.covered)
    assert checked.largest_error < 0.02
    # Shapes left out are what the indicator sees.
    estimates = [float(of_model(model)[2]) for model in models]
    assert all(1e-5 < estimate < 0.05 for estimate in estimates)


@pytest.mark.slow
def test_a_modulated_push_is_as_near_as_a_constant_one_of_its_length(fast, settings):
    """Learnt from half the length: a tenth, where a course that is left out makes it half as large again."""
    usual, at = DESCRIBED.stepwise(), jnp.asarray([40.0])
    found = {}
    for course in (None, Square()):
        protocol = dataclasses.replace(usual, push_duration=2.0 * usual.push_duration, modulation=course)
        heating = fast.curve.heating(MODEL, protocol)
        ours = fast.curve.extrapolated(MODEL, at, protocol, heating=heating)
        full = stepwise_displacement(MODEL, at, protocol, settings, heating=heating)
        found[course] = float(ours[0]), float(full[0])
    for ours, full in found.values():
        np.testing.assert_allclose(ours, full, rtol=0.1)
    assert found[None][1] > 1.5 * found[Square()][1]


@pytest.mark.slow
def test_gradient(rows):
    assert_gradient(lambda z: jnp.sum((rows(z) - 95.0) ** 2), jnp.full(8, 0.1), rtol=1e-6)


def test_many_at_once_are_as_one_after_the_other(rows):
    walkers = jnp.asarray(0.4 * np.random.default_rng(2).normal(size=(3, 8)))
    one_by_one = jnp.stack([rows(z) for z in walkers])
    np.testing.assert_allclose(jax.vmap(rows)(walkers), one_by_one, rtol=1e-9)


def test_displacement_goes_with_the_power(fast, of_model):
    metres = jax.jit(lambda model: fast.predict(model, n_rows=3, in_percent=False))
    twice = eqx.tree_at(lambda model: model.drive.acoustic_power, MODEL, 2.0 * MODEL.drive.acoustic_power)
    np.testing.assert_allclose(metres(twice), 2.0 * metres(MODEL), rtol=1e-9)
    np.testing.assert_allclose(of_model(twice)[0], of_model(MODEL)[0], rtol=1e-9)


def test_outside_of_what_was_trained_on_rows_are_no_numbers(fast, of_model, rows):
    far = 8.0 * np.eye(8)[5]
    assert np.all(np.isnan(rows(jnp.asarray(far)))) and np.all(np.isfinite(rows(jnp.zeros(8))))
    _, excess, indicator = of_model(model_at(far))
    assert excess > 1.0 and np.isinf(indicator)
    fast.require_covered(MODEL)
    with pytest.raises(InputError, match="outside of what the fast model was prepared with"):
        fast.require_covered(model_at(far))
    # Within a batch the others are not touched.
    both = jax.vmap(rows)(jnp.asarray(np.stack([far, np.zeros(8)])))
    assert np.all(np.isnan(both[0])) and np.all(np.isfinite(both[1]))


@pytest.mark.parametrize(
    "place",
    [
        lambda model: model.path[2].tissue.attenuation.value,
        lambda model: model.bowl.focal_length,
        lambda model: model.drive.frequency,
        lambda model: model.liver.density.value,
    ],
)
def test_what_the_table_of_sound_takes_as_given_may_not_differ(of_model, place):
    other = eqx.tree_at(place, MODEL, 1.001 * place(MODEL))
    rows, excess, indicator = of_model(other)
    assert np.all(np.isnan(rows)) and np.isinf(excess) and np.isinf(indicator)


def test_draws_that_differ_in_the_path_are_refused(settings):
    other = eqx.tree_at(lambda model: model.path[1].tissue.sound_speed.value, MODEL, jnp.asarray(1500.0))
    with pytest.raises(InputError, match="draw 1 differs from the first"):
        prepare_fast([MODEL, other], SWEEPS, settings, heat_settings=settings, effort=SMALL)


def test_a_model_built_otherwise_is_refused(fast):
    thinner = eqx.tree_at(lambda model: model.path, MODEL, MODEL.path[:-1])
    with pytest.raises(InputError, match="built otherwise"):
        fast.predict(thinner, **ROWS)


def test_error_of_a_model_is_the_largest_of_its_rows_over_the_largest_of_its_full_curve():
    """And the largest of all is of those that are covered."""
    fast, full = np.array([[50.0, 95.0], [np.nan, np.nan], [220.0, 130.0]]), np.array([[100.0, 80.0]] * 3)
    checked = Verification(fast, full, np.array([True, False, False]))
    np.testing.assert_allclose(checked.errors, [0.5, np.nan, 1.2])
    assert checked.largest_error == 0.5
    assert np.isnan(Verification(fast, full, np.zeros(3, dtype=bool)).largest_error)


class Shapes:
    """In place of a fast curve: displacement rises with temperature, by as much for every shape."""

    class solid:
        n_modes = 9

    @staticmethod
    def extrapolated(model, temperatures, protocol, *, heating, n_modes=9):
        return heating * n_modes * (1.0 + 0.01 * n_modes * (temperatures - temperatures[0]))

    @staticmethod
    def excess(model, temperatures, protocol, *, heating):
        return model.drive.acoustic_power / MODEL.drive.acoustic_power * heating / 100.0


class Stub(FastHmi):
    """In place of a heating the temperature of its end."""

    curve: type = Shapes  # type: ignore[assignment]
    sweeps: tuple = ()

    def _states(self, model, sweep):
        return sweep.protocol.final_temperature, jnp.asarray([sweep.reference_temperature, *sweep.states])


def test_indicator_is_what_the_last_third_of_the_shapes_adds_to_the_worst_curve():
    """Over the largest of it, each curve over its displacement at the reference."""
    fast = Stub(sweeps=(*sweeps_of([70.0, 45.0]), *sweeps_of([50.0])))
    # At 70 degC three hundredths of the 33 K since the reference, of 1 + 0.09 times these; at 50 degC less.
    assert float(fast.indicator(MODEL)) == pytest.approx(0.03 * 33.0 / (1.0 + 0.09 * 33.0), rel=1e-6)
    assert float(fast.excess(MODEL)) == pytest.approx(0.7)
    twice = eqx.tree_at(lambda model: model.drive.acoustic_power, MODEL, 2.0 * MODEL.drive.acoustic_power)
    assert np.isinf(float(fast.indicator(twice)))
    rows = fast.predict(MODEL, n_rows=2, in_percent=True)
    np.testing.assert_allclose(rows[1], 100.0 * (1.0 + 0.09 * 8.0))
    assert np.all(np.isnan(fast.predict(twice, n_rows=2, in_percent=True)))


def freed(count, *, width, seed):
    """Models that differ in much that no calibration of ours fits: warmth, the dose that kills, both solids."""

    def places(model):
        lesion = model.lesion.viscoelasticity
        return (
            model.liver.perfusion_rate.value,
            model.liver.conductivity.value,
            model.liver.viscoelasticity.relaxed_modulus.value,
            model.liver.viscoelasticity.branch_modulus.value,
            model.liver.viscoelasticity.relaxation_time.value,
            model.lesion.size.threshold,
            lesion.branch_modulus.value,
            model.poisson_ratio,
        )

    *standing, ratio = places(MODEL)
    # Bulk over shear modulus goes with this, which spreads as the others do.
    standing = (*standing, 1.0 / (1.0 - 2.0 * ratio))
    rng, models = np.random.default_rng(seed), []
    for number in range(count):
        factors = np.exp(width * 0.25 * rng.normal(size=8)) if number else np.ones(8)
        *new, bulk = (factor * value for factor, value in zip(factors, standing, strict=True))
        models.append(eqx.tree_at(places, MODEL, (*new, 0.5 * (1.0 - 1.0 / bulk))))
    return models


@pytest.mark.slow
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("drawn", [draws, freed])
def test_half_a_percent_of_the_reference_setting_over_the_prior(drawn):
    sweeps = sweeps_of([40.0, 50.0, 55.0, 60.0, 65.0, 70.0])
    fast = prepare_fast(drawn(120, width=1.3, seed=0), sweeps, discretise(MODEL, refinement=2.0))
    checked = fast.verify(drawn(6, width=1.0, seed=7), discretise(MODEL, refinement=3.0), n_rows=6, in_percent=True)
    assert np.sum(checked.covered) >= 5
    assert checked.largest_error < 0.005
