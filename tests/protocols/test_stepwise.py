"""The whole chain on the paper's case: gradients, and what must hold whatever the discretisation."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import arfjax
from arfjax import (
    DoseSize,
    Square,
    discretise,
    focal_temperature_at,
    read_experiment,
    run_stepwise,
    simulate_heating,
    stepwise_displacement,
    suomi2016,
    tabulated_size,
)
from arfjax.acoustics.intensity import heat_deposition
from arfjax.protocols import stepwise
from arfjax.protocols.shear_wave import WatchSettings
from arfjax.protocols.shear_wave import _steps as steps_of_watch
from arfjax.protocols.stepwise import Heating, heating_by, lesion_at

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"


@pytest.fixture(scope="module")
def described():
    return read_experiment(EXPERIMENT)


@pytest.fixture(scope="module")
def model(described):
    return described.model()


@pytest.fixture(scope="module")
def protocol(described):
    return described.stepwise()


@pytest.fixture(scope="module")
def coarse(model):
    return discretise(model, refinement=0.5)


def with_size(model, size):
    return dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, size=size))


def constants(model):
    """Every constant that the mission asks gradients to, by name."""
    attenuation = model.liver.attenuation
    liver, lesion = model.liver.viscoelasticity, model.lesion.viscoelasticity
    return {
        "attenuation coefficients": attenuation.coefficients,
        "liver M_0": liver.relaxed_modulus.value,
        "liver M_inf - M_0": liver.branch_modulus.value,
        "liver tau": liver.relaxation_time.value,
        "lesion M_0": lesion.relaxed_modulus.value,
        "lesion M_inf - M_0": lesion.branch_modulus.value,
        "lesion M_inf - M_0, rate": lesion.branch_modulus.rate,
        "lesion tau": lesion.relaxation_time.value,
        "lesion tau, slope": lesion.relaxation_time.slope,
    }


def with_constants(model, values):
    def replaced(law, **changes):
        return dataclasses.replace(law, **changes)

    liver, lesion = model.liver.viscoelasticity, model.lesion.viscoelasticity
    liver = replaced(
        liver,
        relaxed_modulus=replaced(liver.relaxed_modulus, value=values["liver M_0"]),
        branch_modulus=replaced(liver.branch_modulus, value=values["liver M_inf - M_0"]),
        relaxation_time=replaced(liver.relaxation_time, value=values["liver tau"]),
    )
    lesion = replaced(
        lesion,
        relaxed_modulus=replaced(lesion.relaxed_modulus, value=values["lesion M_0"]),
        branch_modulus=replaced(
            lesion.branch_modulus, value=values["lesion M_inf - M_0"], rate=values["lesion M_inf - M_0, rate"]
        ),
        relaxation_time=replaced(lesion.relaxation_time, value=values["lesion tau"], slope=values["lesion tau, slope"]),
    )
    attenuation = replaced(model.liver.attenuation, coefficients=values["attenuation coefficients"])
    return dataclasses.replace(
        model,
        liver=replaced(model.liver, attenuation=attenuation, viscoelasticity=liver),
        lesion=replaced(model.lesion, viscoelasticity=lesion),
    )


@pytest.fixture(scope="module")
def focal(model, protocol, coarse):
    """Focal displacement at 65 degC, lesion by dose, as a function of the constants, compiled once."""

    def displacement(values):
        changed = with_constants(model, values)
        heating = simulate_heating(changed, protocol, coarse)
        return 1e6 * stepwise_displacement(changed, jnp.asarray([65.0]), protocol, coarse, heating=heating)[0]

    return jax.jit(displacement), jax.jit(jax.grad(displacement))


@pytest.mark.slow
def test_gradient_to_every_coefficient_and_every_zener_constant(model, focal):
    """jax.grad against fourth-order central differences, constant by constant, to 1e-6.

    The steps are as small as rounding allows: the lesion's edge sweeps over Gauss points when the attenuation changes,
    and there the displacement has a kink in its second derivative. The moduli and times move no edge, and their effect
    on so short a push is small, so that their steps are large.
    """
    displacement, gradient = focal
    values = jax.tree.map(jnp.asarray, constants(model))
    slopes = gradient(values)
    for name, value in values.items():
        step = 1e-5 if name == "attenuation coefficients" else 2e-2
        for index in np.ndindex(value.shape):
            # A coefficient's step changes the attenuation by `step` of itself, another constant by `step` of its own.
            size = step * 100.0 / 65.0 ** index[0] if index else step * float(value)

            def moved(distance, name=name, value=value, index=index):
                return float(
                    displacement(values | {name: value.at[index].add(distance) if index else value + distance})
                )

            central = 8.0 * (moved(size) - moved(-size)) - (moved(2.0 * size) - moved(-2.0 * size))
            np.testing.assert_allclose(
                slopes[name][index], central / (12.0 * size), rtol=1e-6, err_msg=f"{name} {index}"
            )


def test_reverse_mode_equals_forward_mode(model, protocol, coarse):
    """Through the plain chain, without the detour by reverse mode that fits take."""
    values = jax.tree.map(jnp.asarray, constants(model))

    def displacement(values):
        return run_stepwise(with_constants(model, values), jnp.asarray([62.0]), protocol, coarse).displacement[0]

    rng = np.random.default_rng(3)
    direction = jax.tree.map(lambda value: jnp.asarray(rng.normal(size=value.shape)) * value, values)
    reverse = jax.tree.map(
        lambda slope, change: jnp.sum(slope * change), jax.jit(jax.grad(displacement))(values), direction
    )
    _, forward = jax.jit(lambda v, d: jax.jvp(displacement, (v,), (d,)))(values, direction)
    np.testing.assert_allclose(sum(jax.tree.leaves(reverse)), forward, rtol=1e-10)


def test_heating_ends_at_the_final_temperature_and_rises_all_the_time(model, protocol, coarse):
    heating = jax.jit(lambda power: simulate_heating(_driven(model, power), protocol, coarse))
    at_50, at_100 = heating(50.0), heating(100.0)
    focal_temperature = np.asarray(at_50.focal_temperature)
    assert focal_temperature[0] == 35.0
    assert focal_temperature[-1] == pytest.approx(70.0, abs=1e-10)
    assert np.all(np.diff(focal_temperature) > 0.0)
    # The power that heats so is the tissue's business, not that of the power for which the field was computed.
    np.testing.assert_allclose(at_50.acoustic_power, at_100.acoustic_power, rtol=1e-12)
    np.testing.assert_allclose(at_50.temperature, at_100.temperature, rtol=1e-12)
    np.testing.assert_allclose(focal_temperature_at(at_50, at_50.time), at_50.focal_temperature, rtol=1e-14)


def _driven(model, power):
    return dataclasses.replace(model, drive=dataclasses.replace(model.drive, acoustic_power=power))


TEMPERATURES = np.asarray([35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0])


@pytest.fixture(scope="module")
def run(protocol, coarse):
    """The protocol as a function of the model, compiled once for each kind of lesion size, whatever its numbers."""
    compiled = eqx.filter_jit(lambda model: run_stepwise(model, jnp.asarray(TEMPERATURES), protocol, coarse))
    return lambda model: compiled(jax.tree.map(jnp.asarray, model))


def percent(result, *temperatures):
    displacement = np.asarray(result.displacement)
    return 100.0 * displacement[np.searchsorted(TEMPERATURES, temperatures)] / displacement[0]


def test_before_ablation_displacement_follows_attenuation_alone(model, run):
    """alpha(T) exp(-2 alpha z) with z = 20 mm of liver before the focus, which the paper's 95 and 105 percent follow.

    The plane-wave estimate leaves out that the edge rays' path is longer and that the force field reaches over some
    millimetres along the beam: together half a percent.
    """
    before = TEMPERATURES[:5]
    simulated = percent(run(with_size(model, tabulated_size())), *before)
    alpha = 1.1 * np.asarray(model.liver.attenuation(before))
    force = alpha * np.exp(-2.0 * alpha * 0.020)
    np.testing.assert_allclose(simulated, 100.0 * force / force[0], atol=0.5)
    stated = suomi2016.TEXT_SIMULATED_DISPLACEMENT_PERCENT
    assert simulated[2] == pytest.approx(stated[45.0], abs=0.7)
    assert simulated[4] == pytest.approx(stated[55.0], abs=0.7)


def test_a_lesion_of_the_table_in_the_true_linear_field_agrees_with_another_code(model, run):
    """108, 103 and 94 percent at 60, 65 and 70 degC, by other finite elements with the linear field of this bowl.

    (tests/reference/mechanics/SOURCE.md.) Their field was that of a homogeneous path, so that two points are allowed.
    """
    simulated = percent(run(with_size(model, tabulated_size())), 60.0, 65.0, 70.0)
    np.testing.assert_allclose(simulated, [108.0, 103.0, 94.0], atol=2.0)


def test_a_thin_layer_keeps_its_cells(model):
    """Two interfaces nearer than a cell get a face each."""
    thin = dataclasses.replace(model.path[1], thickness=0.2e-3)
    water = dataclasses.replace(model.path[0], thickness=model.path[0].thickness + 1.8e-3)
    fat = dataclasses.replace(model.path[2], thickness=0.4e-3)
    muscle = dataclasses.replace(model.path[3], thickness=19.6e-3)
    path = (water, thin, fat, muscle)
    settings = discretise(dataclasses.replace(model, path=path), refinement=0.5)
    faces = settings.heat_grid.z_faces
    interfaces = np.cumsum([layer.thickness for layer in path])
    assert np.all(np.min(np.abs(faces[:, None] - interfaces[None, interfaces > faces[0]]), axis=0) == 0.0)


@pytest.mark.slow
def test_single_precision(described, protocol, run, model):
    with jax.enable_x64(False):
        single_model = described.model()
        settings = discretise(single_model, refinement=0.5)
        temperatures = jnp.asarray(TEMPERATURES, dtype=jnp.float32)
        single = eqx.filter_jit(lambda model: run_stepwise(model, temperatures, protocol, settings))(single_model)
        assert single.displacement.dtype == jnp.float32
    double = run(model)
    np.testing.assert_allclose(single.displacement, double.displacement, rtol=1e-4)
    np.testing.assert_allclose(single.lesion_length, double.lesion_length, rtol=1e-2)


def test_displacement_is_proportional_to_power(model, run):
    np.testing.assert_allclose(
        3.0 * run(_driven(model, 20.0)).displacement, run(_driven(model, 60.0)).displacement, rtol=1e-12
    )


def test_a_lesion_stiffens_and_table_and_dose_differ_only_in_size(model, run):
    none, table, dose = (
        run(with_size(model, size)) for size in (DoseSize(threshold=1e30), tabulated_size(), DoseSize())
    )
    assert float(none.lesion_length[-1]) == 0.0
    for step, temperature in enumerate(TEMPERATURES[-3:], start=5):
        row = suomi2016.TABLE_3_LESION[float(temperature)]
        assert float(table.lesion_length[step]) == pytest.approx(1e-3 * row.length_mm)
        assert float(table.lesion_diameter[step]) == pytest.approx(1e-3 * row.diameter_mm)
        assert dose.displacement[step] < table.displacement[step] < none.displacement[step]
    assert np.all(np.diff(dose.lesion_length) >= 0.0)
    np.testing.assert_allclose(dose.displacement[:4], none.displacement[:4], rtol=1e-14)


def test_the_fit_s_displacement_is_the_run_s(model, protocol, coarse, run):
    def alone(model):
        heating = simulate_heating(model, protocol, coarse)
        return stepwise_displacement(model, jnp.asarray(TEMPERATURES), protocol, coarse, heating=heating)

    np.testing.assert_allclose(eqx.filter_jit(alone)(model), run(model).displacement, rtol=1e-12)


def test_a_modulated_push_is_the_difference_of_two_that_go_on(model, protocol, coarse):
    """On for the half in its middle: motion is linear in the force."""
    longer = dataclasses.replace(protocol, push_duration=2e-3)
    middle = dataclasses.replace(longer, modulation=Square())

    def histories(model):
        heating = simulate_heating(model, protocol, coarse)
        at = jnp.asarray(TEMPERATURES[-1:])
        return [run_stepwise(model, at, p, coarse, heating=heating).displacement_history[0] for p in (longer, middle)]

    on, found = eqx.filter_jit(histories)(model)
    quarter = (len(on) - 1) // 4
    np.testing.assert_allclose(found[-1], on[3 * quarter] - on[quarter], rtol=1e-9)


def test_whoever_pushes_by_the_protocol_takes_its_course(protocol, coarse):
    modulated = dataclasses.replace(protocol, modulation=Square())
    assert modulated.push_steps(coarse).modulation == Square() and protocol.push_steps(coarse).modulation is None
    assert steps_of_watch(modulated, WatchSettings(duration=2e-3)).modulation == Square()


@pytest.mark.slow
def test_default_discretisation_is_within_its_stated_accuracy(model, protocol):
    """Half the spacings and steps everywhere move the normalised curve by less than `Discretisation` states."""
    temperatures = jnp.asarray([35.0, 45.0, 55.0, 60.0, 65.0, 70.0])
    curves = []
    for refinement in (1.0, 2.0):
        settings = discretise(model, refinement=refinement)
        run = eqx.filter_jit(lambda model, settings=settings: run_stepwise(model, temperatures, protocol, settings))
        curves.append(np.asarray(run(model).displacement))
    np.testing.assert_allclose(curves[0], curves[1], rtol=arfjax.DISPLACEMENT_ACCURACY)


def test_heat_that_no_power_makes_cannot_be_scaled_with_the_power(model, protocol, coarse):
    warm = eqx.tree_at(lambda tree: tree.liver.metabolic_heat.value, model, 1.2e4)
    heat = jnp.ones(coarse.heat_grid.shape)
    with pytest.raises(arfjax.InputError, match="metabolic heat warms up without sound"):
        heating_by(warm, heat, protocol, coarse)
    traced = jax.jit(lambda numbers: heating_by(numbers, heat, protocol, coarse).focal_temperature)
    assert np.all(np.isnan(traced(jax.tree.map(jnp.asarray, warm))[1:]))
    assert np.all(np.isfinite(traced(jax.tree.map(jnp.asarray, model))))


def test_a_heating_refuses_sound_that_is_none_before_it_compiles_any(model, protocol, coarse):
    attenuation = model.liver.attenuation
    spoiled = eqx.tree_at(
        lambda tree: tree.liver.attenuation.coefficients, model, jnp.full_like(attenuation.coefficients, jnp.nan)
    )
    with pytest.raises(arfjax.InputError, match="not finite"):
        simulate_heating(spoiled, protocol, coarse)
    quick = eqx.tree_at(lambda tree: tree.drive.frequency, model, jnp.asarray(20e6))
    with pytest.raises(arfjax.InputError, match="does not resolve"):
        simulate_heating(quick, protocol, coarse)


def test_a_protocol_that_no_sonication_can_follow_is_refused():
    for wrong, match in (
        ({"start_temperature": 70.0, "final_temperature": 35.0}, "must lie above"),
        ({"start_temperature": 308.15, "final_temperature": 343.15}, "Kelvin"),
        ({"duration": 0.0}, "`duration` must be positive"),
        ({"push_duration": float("nan")}, "`push_duration` must be positive"),
    ):
        with pytest.raises(arfjax.InputError, match=match):
            arfjax.StepwiseProtocol(**wrong)


def test_temperatures_that_the_sonication_never_reaches_are_refused(model, protocol, coarse):
    nothing = jnp.zeros((2, *coarse.heat_grid.shape))
    heating = Heating(jnp.asarray([0.0, 60.0]), jnp.asarray([35.0, 70.0]), nothing, nothing, jnp.asarray(50.0))
    for outside in (80.0, 34.0):
        with pytest.raises(arfjax.InputError, match="from 35 to 70 degC and never to all of"):
            lesion_at(model, heating, outside, coarse)
        for run in (run_stepwise, stepwise_displacement):
            with pytest.raises(arfjax.InputError, match="from 35 to 70 degC and never to all of"):
                run(model, jnp.asarray([40.0, outside]), protocol, coarse, heating=heating)
    assert float(lesion_at(model, heating, 70.0 + 1e-9, coarse).length) == 0.0
    held = jax.jit(lambda temperature: lesion_at(model, heating, temperature, coarse).length)
    assert float(held(jnp.asarray(80.0))) == 0.0


def test_a_drive_that_does_not_heat_is_refused(model, protocol, coarse):
    with pytest.raises(arfjax.InputError, match="does not warm the focus"):
        heating_by(model, jnp.zeros(coarse.heat_grid.shape), protocol, coarse)


def test_a_heating_that_comes_again_compiles_no_sound(model, protocol, coarse, monkeypatch):
    traced = []

    def counted(field):
        traced.append(field)
        return heat_deposition(field)

    monkeypatch.setattr(stepwise, "heat_deposition", counted)
    # An equal discretisation that no other test has had compiled.
    mine = dataclasses.replace(coarse)
    first = simulate_heating(model, protocol, mine)
    again = simulate_heating(model, dataclasses.replace(protocol, final_temperature=60.0), mine)
    assert len(traced) == 1
    assert float(again.acoustic_power) == pytest.approx(float(first.acoustic_power) * 25.0 / 35.0)
    simulate_heating(model, protocol, dataclasses.replace(coarse))
    assert len(traced) == 2
