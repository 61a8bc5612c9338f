"""A watched sonication: what it must be where nothing heats, where it must agree with other protocols, gradients."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import (
    DamageEdge,
    InputError,
    Layer,
    Phase,
    ShortPush,
    SineIntensity,
    SinePressure,
    Sonication,
    Square,
    SteadyShaking,
    Thermocouple,
    TransientProtocol,
    discretise,
    protocol_ladder,
    read_experiment,
    run_stepwise,
    run_transient,
    sonicate,
    tissues,
    vibrate,
)
from arfjax.laws import Constant
from arfjax.mechanics.material.lesion import at_gauss_points
from arfjax.numerics.host_factors import STORE, release_factors
from arfjax.protocols.probing import on_axis_at
from arfjax.protocols.stepwise import simulate_heating
from arfjax.protocols.transient import TissueState, probe_at, solid_of, tissue_states, value_when
from arfjax.protocols.vibration import VibrationSettings
from arfjax.thermal.bioheat import TemperatureHistory
from tests.checks import assert_gradient_of_each_leaf

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"
DESCRIBED = read_experiment(EXPERIMENT)
PAPERS = DESCRIBED.model()
# Water and liver alone: every layer more takes as long again to compile.
MODEL = dataclasses.replace(PAPERS, path=(Layer(PAPERS.path[0].tissue, PAPERS.liver_depth),))
BY_DOSE = dataclasses.replace(MODEL, lesion=dataclasses.replace(MODEL.lesion, edge=DamageEdge()))
STEPWISE = DESCRIBED.stepwise()
SETTINGS = discretise(MODEL, refinement=0.4)
COARSE = VibrationSettings(element=0.8e-3, coarsest=4e-3)
HOT = 0.235  # of the file's power
SHAKING = SteadyShaking(50.0, SineIntensity(), COARSE)
WIRE = Thermocouple(radial_offset=1e-3, viscous_fraction=0.5, viscous_time_constant=2.0)


def plan(*powers: float, start: float = 35.0, tolerance: float = 2.0) -> Sonication:
    """Half a minute at each power in ten steps."""
    return Sonication(tuple(Phase(30.0, 10, power) for power in powers), start, tolerance)


def at_power(model, factor: float):
    drive = dataclasses.replace(model.drive, acoustic_power=factor * model.drive.acoustic_power)
    return dataclasses.replace(model, drive=drive)


def watched(model, protocol):
    return eqx.filter_jit(lambda model: run_transient(model, protocol, SETTINGS))(model)


@pytest.fixture(scope="module")
def heated():
    """To 75 degC at the focus, with a lesion."""
    return watched(at_power(BY_DOSE, HOT), TransientProtocol(plan(1.0, 0.0), ShortPush(), thermocouple=WIRE))


@pytest.mark.parametrize("probe", [ShortPush(), SHAKING], ids=["push", "shaking"])
def test_without_heat_it_is_the_stepwise_protocol_s_first_step(probe):
    result = watched(MODEL, TransientProtocol(plan(1e-9), probe))
    if isinstance(probe, ShortPush):
        expected = eqx.filter_jit(lambda m: run_stepwise(m, jnp.asarray([35.0]), STEPWISE, SETTINGS))(MODEL)
        expected = expected.displacement[0]
    else:
        heating = eqx.filter_jit(lambda m: simulate_heating(m, STEPWISE, SETTINGS))(MODEL)
        shaken = eqx.filter_jit(
            lambda m, at: vibrate(
                m,
                at,
                STEPWISE,
                SETTINGS,
                heating=heating,
                frequency=50.0,
                modulation=SineIntensity(),
                vibration=COARSE,
            )
        )(MODEL, jnp.asarray(35.0))
        expected = shaken.peak_to_peak
    # The heat of a billionth of 50 W moves attenuation by 1e-9 of itself.
    np.testing.assert_allclose(result.displacement, expected, rtol=1e-7)
    assert result.computed[0] and result.computed[-1] and int(jnp.sum(result.computed)) == 2


def test_it_is_computed_again_only_where_tissue_has_moved_and_linear_in_between(heated):
    computed = np.asarray(heated.computed)
    assert 5 < computed.sum() < len(computed)
    time, known = np.asarray(heated.time), np.flatnonzero(computed)
    expected = np.interp(time, time[known], np.asarray(heated.displacement)[known])
    np.testing.assert_allclose(heated.displacement, expected, rtol=1e-12)


@pytest.mark.slow
def test_the_tolerance_costs_less_than_its_docstring_says(heated):
    fine = watched(at_power(BY_DOSE, HOT), TransientProtocol(plan(1.0, 0.0), ShortPush(), 0.01))
    assert bool(jnp.all(fine.computed[:11]))
    assert float(jnp.max(jnp.abs(heated.displacement / fine.displacement - 1.0))) < 5e-3


def test_each_computed_value_is_that_of_its_state(heated):
    model, sonication = at_power(BY_DOSE, HOT), plan(1.0, 0.0)
    states = tissue_states(heated.sonication)
    probe = eqx.filter_jit(lambda model, state: probe_at(model, ShortPush(), sonication, SETTINGS, state))
    for index in np.flatnonzero(np.asarray(heated.computed))[[3, -1]]:
        again = probe(model, states.at(int(index)))
        np.testing.assert_allclose(heated.displacement_map[index], again, rtol=1e-9, atol=1e-16)
        on_axis = on_axis_at(again, SETTINGS.mesh, SETTINGS.focus)
        np.testing.assert_allclose(heated.displacement[index], on_axis, rtol=1e-9)


def test_the_lesion_outlasts_the_heat(heated):
    """After cooling the beam moves coagulated tissue less than it did the fresh one, and the table remembers."""
    states = tissue_states(heated.sonication)
    assert float(states.focal[-1]) == float(jnp.max(heated.sonication.focal_temperature))
    assert float(heated.sonication.focal_temperature[-1]) < 60.0
    assert float(heated.displacement[-1]) < 0.9 * float(heated.displacement[0])
    solid = eqx.filter_jit(lambda state: solid_of(BY_DOSE, SETTINGS, state, SETTINGS.mesh))(states.at(-1))
    focus = int(np.argmin(np.abs(SETTINGS.mesh.gauss_z - SETTINGS.focus)))
    # There all has coagulated, with the modulus of the hottest moment, which liver's own would not show any more.
    hottest = at_gauss_points(SETTINGS.mesh, SETTINGS.heat_grid, states.hottest[-1])[0, focus]
    stiff = float(jax.jit(lambda at: BY_DOSE.lesion.viscoelasticity(at).unrelaxed_modulus)(hottest))
    assert float(jnp.asarray(solid.unrelaxed_modulus)[0, focus]) == pytest.approx(stiff, rel=1e-3)


def test_coagulated_tissue_that_absorbs_twice_as_much_is_pushed_twice_as_far():
    """Where sound loses next to nothing on its way, and a lesion is no stiffer than liver."""
    clear = Constant(1e-4, unit="Np/m", source="test")  # over the liver's 40 mm and back a hundred-thousandth
    liver = tissues.attenuating(dataclasses.replace(MODEL.liver, attenuation=clear))
    soft = dataclasses.replace(MODEL.lesion, viscoelasticity=liver.viscoelasticity)
    model, settings = dataclasses.replace(MODEL, liver=liver, lesion=soft), discretise(MODEL, refinement=0.2)
    shape = settings.heat_grid.shape
    warm = jnp.full(shape, 37.0)

    @eqx.filter_jit
    def moved(model, dose):
        state = TissueState(warm, warm, jnp.asarray(37.0), dose)
        return probe_at(model, ShortPush(), plan(1.0, start=37.0), settings, state)

    fresh, dead = (moved(model, jnp.full(shape, dose)) for dose in (0.0, 1e8))
    np.testing.assert_allclose(dead, 2.0 * fresh, rtol=0.0, atol=1e-4 * float(jnp.max(fresh)))


def test_uniform_tissue_has_uniform_constants():
    shape = SETTINGS.heat_grid.shape
    state = TissueState(jnp.full(shape, 48.0), jnp.full(shape, 48.0), jnp.asarray(48.0), jnp.zeros(shape))
    # Traced, laws do not warn of the lesion's, of which there is none.
    solid = eqx.filter_jit(lambda state: solid_of(MODEL, SETTINGS, state, SETTINGS.mesh))(state)
    expected = MODEL.liver.viscoelasticity(48.0)
    for name in ("relaxed_modulus", "unrelaxed_modulus", "relaxation_time"):
        np.testing.assert_allclose(getattr(solid, name), float(getattr(expected, name)), rtol=1e-12)


@pytest.mark.parametrize(
    ("modulation", "mean"), [(SineIntensity(), 0.5), (SinePressure(), 0.375), (Square(0.3), 0.3)], ids=str
)
def test_a_modulated_beam_heats_with_its_mean(modulation, mean):
    """From the integral over a period of the force, which the sonication alone then has as its power."""
    phase = np.linspace(0.0, 2.0 * np.pi, 20_001)[:-1]
    np.testing.assert_allclose(np.mean(np.asarray(modulation.force(phase))), mean, atol=1e-4)
    np.testing.assert_allclose(SteadyShaking(50.0, modulation).mean_force(), mean, rtol=1e-12)


@pytest.mark.slow
def test_the_heat_is_that_of_the_sonication_at_the_mean_power():
    result = watched(at_power(MODEL, 0.2), TransientProtocol(plan(1.0), SHAKING))
    alone = eqx.filter_jit(lambda m: sonicate(m, plan(1.0), SETTINGS))(at_power(MODEL, 0.1))
    np.testing.assert_allclose(result.sonication.temperature, alone.temperature, rtol=1e-9)


def test_the_thermocouple_is_read_as_an_instrument(heated):
    course = heated.sonication
    history = TemperatureHistory(course.time, course.temperature)
    capacity = SETTINGS.thermal_field(BY_DOSE, 35.0).heat_capacity

    @eqx.filter_jit
    def read(thermocouple):
        heat = {"heat": course.heat, "heat_capacity": capacity}
        return thermocouple(history, SETTINGS.heat_grid, z=SETTINGS.focus, **heat)

    perfect, beside, shown = read(Thermocouple()), read(dataclasses.replace(WIRE, viscous_fraction=0.0)), read(WIRE)
    np.testing.assert_allclose(perfect, course.focal_temperature, atol=0.05)
    assert float(jnp.max(beside)) < float(jnp.max(perfect)) - 5.0
    assert float(jnp.max(shown - beside)) > 1.0  # what sound does to the wire, beyond heating tissue
    np.testing.assert_allclose(heated.thermocouple_temperature - beside, shown - beside, rtol=1e-9, atol=1e-9)


def test_value_when_a_course_reaches_a_level():
    course, values = jnp.asarray([20.0, 30.0, 50.0, 40.0]), jnp.asarray([1.0, 2.0, 4.0, 9.0])
    assert [float(value_when(course, values, level)) for level in (20.0, 25.0, 40.0, 50.0)] == [1.0, 1.5, 3.0, 4.0]
    assert np.isnan(float(value_when(course, values, 51.0))) and np.isnan(float(value_when(course, values, 19.0)))
    # A start that is the level but for rounding is at the level.
    assert float(value_when(course, values, 20.0 - 1e-12)) == 1.0
    assert float(value_when(course, values, 50.0 + 1e-12)) == 4.0
    assert float(jax.grad(lambda level: value_when(course, values, level))(40.0)) == pytest.approx(0.1)


def test_normalised_is_one_at_its_temperature(heated):
    shown, curve = heated.thermocouple_temperature, heated.normalised(50.0)
    np.testing.assert_allclose(value_when(shown, curve, 50.0), 1.0, rtol=1e-12)


@pytest.mark.slow
def test_gradient_of_the_course_to_every_kind_of_constant():
    """Attenuation, Zener constants of liver and lesion, a layer's sound speed, conductivity, heat capacity."""
    # The field of the start throughout: when it is computed again is a jump.
    protocol = TransientProtocol(Sonication((Phase(30.0, 6),), 35.0), ShortPush(), 1e-3)
    base = jax.tree.map(jnp.asarray, at_power(BY_DOSE, HOT))

    def where(model):
        liver, lesion = model.liver, model.lesion.viscoelasticity
        return (
            liver.attenuation.coefficients,
            liver.viscoelasticity.branch_modulus.value,
            lesion.branch_modulus.value,
            liver.conductivity.value,
            liver.specific_heat.value,
            model.path[0].tissue.density.value,
        )

    names = ("attenuation", "liver", "lesion", "conductivity", "specific heat", "water density")

    def displacement(constants):
        model = eqx.tree_at(where, base, tuple(constants[name] for name in names))
        return 1e6 * run_transient(model, protocol, SETTINGS).displacement[-1]

    constants = dict(zip(names, where(base), strict=True))
    assert_gradient_of_each_leaf(jax.jit(displacement), constants, rtol=1e-5)


def test_the_gradient_needs_the_factors_of_one_motion_at_a_time(monkeypatch):
    """Outside the scan, the motion of the start is computed again too early, and its factors are dropped."""
    monkeypatch.setattr(STORE, "limit", 1)
    release_factors()
    protocol = TransientProtocol(plan(1.0), ShortPush())
    base = jax.tree.map(jnp.asarray, at_power(MODEL, HOT))

    def displacement(density):
        model = eqx.tree_at(lambda m: m.path[0].tissue.density.value, base, density)
        return jnp.sum(1e6 * run_transient(model, protocol, SETTINGS).displacement)

    assert np.isfinite(jax.jit(jax.grad(displacement))(base.path[0].tissue.density.value))


@pytest.mark.slow
def test_rungs_of_the_ladder():
    """Cold, all rungs of one probe are one; a rung differs from the one before only where its cause acts."""
    model = at_power(MODEL, HOT)
    sonication = plan(1.0, tolerance=1.0)
    temperatures = jnp.asarray([35.0, 45.0, 70.0])
    given = (tissues.fractional_liver_viscoelasticity(), tissues.fractional_lesion_viscoelasticity())

    @eqx.filter_jit
    def climb(model):
        heat = sonicate(model, sonication, SETTINGS)
        return protocol_ladder(
            model, heat, sonication, STEPWISE, SETTINGS, temperatures, shaking=SHAKING, fractional=given
        )

    rungs = {rung.name: np.asarray(rung.displacement) for rung in climb(model)}
    for name in ("heating", "local absorption", "path", "lesion shape"):
        np.testing.assert_allclose(rungs[name][0], rungs["stepwise"][0], rtol=1e-8)
    np.testing.assert_allclose(rungs["heating"][1], rungs["stepwise"][1], rtol=1e-8)  # no lesion yet
    np.testing.assert_allclose(rungs["lesion shape"][1], rungs["path"][1], rtol=1e-3)
    assert abs(rungs["local absorption"][1] / rungs["heating"][1] - 1.0) > 1e-3
    assert rungs["lesion shape"][2] < rungs["path"][2]
    assert list(rungs)[-2:] == ["shaking", "fractional solid"]
    assert all(np.all(np.isfinite(values)) for values in rungs.values())


def test_nonsense_is_refused(heated):
    with pytest.raises(InputError, match="tolerance"):
        TransientProtocol(plan(1.0), tolerance=0.0)
    with pytest.raises(InputError, match="Give seconds"):
        ShortPush(0.5)
    table = read_experiment(EXPERIMENT).model_copy(
        update={"lesion": DESCRIBED.lesion.model_copy(update={"size": "table"})}
    )
    with pytest.raises(InputError, match="DoseSize"):
        protocol_ladder(
            table.model(), heated.sonication, plan(1.0), STEPWISE, SETTINGS, jnp.asarray([35.0]), shaking=SHAKING
        )
