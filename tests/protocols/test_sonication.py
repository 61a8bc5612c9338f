"""Sonication with feedback on the paper's case, coarse: against its parts, what feedback does, gradients, batches."""

import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import DoseSize, discretise, heat_deposition, read_experiment, solve_bioheat, solve_field, tissues
from arfjax.acoustics.layers import AcousticLayer
from arfjax.protocols.sonication import AdaptiveSteps, Sonication, sonicate, sonication_field
from arfjax.thermal.bioheat import Phase, TemperatureHistory, boiling_time
from arfjax.thermal.feedback import FROZEN
from arfjax.thermal.lesion import lesion_growth
from tests.checks import assert_gradient_of_each_leaf

PAPERS = read_experiment(Path(__file__).parents[2] / "examples" / "suomi2016.toml").model()
# Tissue that dies of a quarter of the dose, so that no default passes for the model's own.
MODEL = dataclasses.replace(PAPERS, lesion=dataclasses.replace(PAPERS.lesion, size=DoseSize(60.0)))
COARSE = discretise(MODEL, refinement=0.5)
FOCUS = 0, int(np.argmin(np.abs(COARSE.heat_grid.z - COARSE.focus)))
PHASES = (Phase(3.0, 4), Phase(1.0, 2, 0.0), Phase(1.0, 2, 0.5))
TOLERANCE = 6.0


def at_power(power, model=MODEL):
    return dataclasses.replace(model, drive=dataclasses.replace(model.drive, acoustic_power=power))


@functools.partial(jax.jit, static_argnames=("tolerance", "steps"))
def run(power, tolerance=FROZEN, steps=None):
    options = {} if steps is None else {"steps": steps}
    return sonicate(at_power(power), Sonication(PHASES, field_tolerance=tolerance), COARSE, **options)


@pytest.fixture(scope="module")
def frozen():
    return run(50.0)


@pytest.fixture(scope="module")
def following():
    return run(50.0, tolerance=TOLERANCE)


def test_frozen_field_and_constant_laws_are_field_heat_and_bioheat(frozen):
    """The path of the paper: one field at the start temperature, its heat, constants of 37 degC."""
    layers = [AcousticLayer(layer.tissue.acoustic(37.0), layer.thickness) for layer in MODEL.layers]
    field, grid = COARSE.thermal_field(MODEL, 37.0), COARSE.heat_grid
    options = {"phases": PHASES, "initial_temperature": 37.0, "arterial_temperature": 37.0}

    @jax.jit
    def parts():
        sound = solve_field(MODEL.bowl, MODEL.drive, layers, r=grid.r, z=grid.z, settings=COARSE.march)
        heat = heat_deposition(sound)
        return heat, solve_bioheat(field, heat, grid, **options)

    heat, expected = parts()
    np.testing.assert_allclose(frozen.heat[0], heat, rtol=1e-8, atol=1e-8 * np.abs(heat).max())
    np.testing.assert_allclose(frozen.temperature, expected.temperature, rtol=1e-8)
    assert np.all(frozen.field_updates == 0)
    assert float(frozen.focal_temperature.max()) > 50.0


def test_the_field_follows_where_tissue_has_moved(frozen, following):
    """Attenuation of liver grows beyond 50 degC: more heat at the focus, in proportion, and a shadow behind it."""
    updates = np.asarray(following.field_updates)
    assert updates[3] == 3 and updates[5] == updates[3]  # none while the power is off
    assert following.focal_temperature[4] > frozen.focal_temperature[4] + 1.0
    # The last step of heating asked for the temperatures at its start and half of what the step before had added.
    before, now = np.asarray(following.temperature)[2:4, 0]
    temperature = now + np.clip(0.5 * (now - before), -0.5 * TOLERANCE, 0.5 * TOLERANCE)

    def law(temperature):
        return MODEL.liver.attenuation.held(temperature, 0.0)

    inside = np.asarray(COARSE.layer_of_cell) == len(MODEL.path)
    grown = np.asarray(law(temperature) / law(37.0))[inside]
    passed = np.asarray(following.heat[3, 0] / following.heat[0, 0])[inside] / grown
    assert grown[np.argmax(temperature[inside])] > 1.5
    beyond = COARSE.heat_grid.z[inside] - COARSE.focus
    behind = (beyond > 1e-3) & (beyond < 3e-3)
    assert behind.sum() >= 2
    # Most sound comes round the heated core, so the shadow is far lighter than what the axis itself would lose.
    lost = 2.0 * np.sum(
        (law(temperature) - law(37.0)) * np.diff(COARSE.heat_grid.z_faces) * 1.1**1.1 * (temperature > 50.0)
    )
    assert np.all(passed[behind] < 0.998) and np.all(passed[behind] > np.exp(-lost))
    # Near the field's zeros a slight change of the beam shows many times enlarged.
    strong = np.asarray(following.heat[0, 0])[inside] > 0.1 * float(following.heat[0, 0].max())
    np.testing.assert_allclose(passed[strong], 1.0, atol=0.015)


def test_field_of_hot_tissue_is_that_of_its_laws():
    """The whole of the liver's grid at one temperature; what is fresh there is the layer itself."""
    grid = COARSE.heat_grid

    @jax.jit
    def field(temperature):
        states = jnp.full(grid.shape, temperature), jnp.zeros(grid.shape)
        return sonication_field(MODEL, Sonication(PHASES), COARSE, *states, r=grid.r, z=grid.z)

    cold, hot = field(37.0), field(65.0)
    inside = np.asarray(COARSE.layer_of_cell) == len(MODEL.path)
    law = MODEL.liver.attenuation.evaluate
    liver = MODEL.liver.acoustic(37.0)
    for field_there, temperature in ((cold, 37.0), (hot, 65.0)):
        expected = float(law(temperature)) * 1.1 ** float(liver.absorption_exponent)
        np.testing.assert_allclose(field_there.attenuation[0][:, inside], expected, rtol=1e-9)
    # The path's laws are constants.
    np.testing.assert_allclose(hot.attenuation[0][:, ~inside], cold.attenuation[0][:, ~inside], rtol=1e-12)


def test_boiling_is_told(following):
    def told(temperature):
        return float(boiling_time(TemperatureHistory(following.time, temperature), COARSE.heat_grid))

    assert float(following.temperature.max()) < 100.0 and np.isnan(following.boiling_time)
    for step in (2, 3):
        assert told(following.temperature.at[step:, 1, 3].set(100.0)) == float(following.time[step])
    # Between the axis and the first cells, where cells themselves are below 100 degC.
    assert told(following.temperature.at[3, :2, 3].set(jnp.asarray([99.5, 95.0]))) == float(following.time[3])
    # A run that did not come to its end is not one that boils.
    assert np.isnan(told(following.temperature.at[5:].set(jnp.inf)))


def test_dose_changes_the_field():
    """Liver whose attenuation doubles as it coagulates, at one temperature, before and after a lethal dose."""
    grid, model = COARSE.heat_grid, dataclasses.replace(MODEL, liver=tissues.attenuating(MODEL.liver))

    @jax.jit
    def attenuation(dose):
        states = jnp.full(grid.shape, 37.0), jnp.full(grid.shape, dose)
        return sonication_field(model, Sonication(PHASES), COARSE, *states, r=grid.r, z=grid.z).attenuation[0]

    inside = np.asarray(COARSE.layer_of_cell) == len(MODEL.path)
    ratio = np.asarray(attenuation(1e8) / attenuation(0.0))
    np.testing.assert_allclose(ratio[:, inside], 2.0, rtol=1e-4)
    np.testing.assert_allclose(ratio[:, ~inside], 1.0, rtol=1e-12)


def test_results_agree_with_one_another(following):
    """Dose, lesion and time belong to the temperatures; damage counts from the same history."""
    np.testing.assert_allclose(following.time, [0.0, 0.75, 1.5, 2.25, 3.0, 3.5, 4.0, 4.5, 5.0], rtol=1e-14)
    assert np.all(np.diff(following.dose, axis=0) > 0.0) and np.all(np.diff(following.damage, axis=0) > 0.0)
    assert float(following.dose[-1, 0].max()) == float(following.dose[-1].max())  # on the axis
    lesion = lesion_growth(following.dose, COARSE.heat_grid, threshold=60.0)
    assert float(lesion.length[-1]) > float(lesion.length[2]) > 0.0
    for name in ("length", "diameter", "volume", "centre"):
        np.testing.assert_allclose(getattr(following.lesion, name), getattr(lesion, name), rtol=1e-12)
    assert bool(following.effort.converged) and int(following.effort.n_steps) == 8


@pytest.mark.slow
def test_powers_as_a_batch(frozen):
    batch = jax.jit(jax.vmap(run))(jnp.asarray([25.0, 50.0]))
    np.testing.assert_allclose(batch.temperature[1], frozen.temperature, rtol=1e-10)
    # Thermal constants do not change: everything but dose is linear in power.
    np.testing.assert_allclose(2.0 * (batch.temperature[0] - 37.0), frozen.temperature - 37.0, rtol=1e-8, atol=1e-9)


@pytest.mark.slow
def test_a_smaller_tolerance_comes_closer(frozen, following):
    finest = run(50.0, tolerance=1e-6)
    assert int(finest.field_updates[-1]) == 5  # each step but the first, and none of the break
    far, near = (float(np.abs(each.temperature - finest.temperature).max()) for each in (frozen, following))
    assert near < 0.6 * far and far > 1.0


@pytest.mark.slow
def test_adaptive_steps_meet_fixed_ones(frozen):
    fine = jax.jit(
        lambda: sonicate(MODEL, Sonication(tuple(Phase(p.duration, 40 * p.n_steps, p.power) for p in PHASES)), COARSE)
    )()
    errors = []
    for error in (0.4, 0.1):
        got = run(50.0, steps=AdaptiveSteps(error, "forward"))
        np.testing.assert_allclose(got.time, frozen.time, rtol=1e-14)
        errors.append(float(np.abs(got.temperature - fine.temperature[::40]).max()))
        assert bool(got.effort.converged) and errors[-1] < 0.3 * error
    assert errors[1] < 0.5 * errors[0]


def changed(p):
    """The liver of these constants, which stops bleeding where it coagulates."""
    liver = tissues.coagulating(MODEL.liver)
    coefficients = jnp.stack([p[f"attenuation {i}"] for i in range(5)])
    attenuation = dataclasses.replace(liver.attenuation, coefficients=coefficients)
    conductivity = dataclasses.replace(liver.conductivity, value=p["conductivity"])
    liver = dataclasses.replace(liver, attenuation=attenuation, conductivity=conductivity)
    return at_power(p["power"], dataclasses.replace(MODEL, liver=liver))


def log_focal_dose(p):
    phases = (Phase(p["heating"], 4), Phase(0.5, 1, 0.0))
    result = sonicate(changed(p), Sonication(phases, field_tolerance=TOLERANCE), COARSE)
    return jnp.log(result.dose[-1][FOCUS])


@pytest.mark.slow
def test_gradient_of_focal_dose():
    """Of its logarithm in the five coefficients of attenuation, conductivity, power and time, through field updates."""
    coefficients = np.asarray(MODEL.liver.attenuation.coefficients).tolist()
    p = {f"attenuation {i}": each for i, each in enumerate(coefficients)}
    p |= {"conductivity": 0.52, "power": 50.0, "heating": 3.0}
    assert_gradient_of_each_leaf(log_focal_dose, p, step=1e-4)
