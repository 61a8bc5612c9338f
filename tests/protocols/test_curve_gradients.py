"""Gradients of every point of the displacement curve to every kind of constant, end to end, against differences."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import discretise, read_experiment, simulate_heating, stepwise_displacement

DESCRIBED = read_experiment(Path(__file__).parents[2] / "examples" / "suomi2016.toml")
PROTOCOL = DESCRIBED.stepwise()
TEMPERATURES = jnp.asarray([35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0])
NUMBERS = jax.tree.map(jnp.asarray, DESCRIBED.model())
SETTINGS = discretise(DESCRIBED.model(), refinement=0.5)


def liver_laws(model):
    liver, lesion = model.liver.viscoelasticity, model.lesion.viscoelasticity
    return [
        liver.relaxed_modulus.value,
        liver.branch_modulus.value,
        liver.relaxation_time.value,
        lesion.relaxed_modulus.value,
        lesion.branch_modulus.value,
        lesion.branch_modulus.rate,
        lesion.relaxation_time.value,
        lesion.relaxation_time.slope,
    ]


def layer_constants(model):
    return [
        getattr(layer.tissue, name).value
        for layer in model.layers
        for name in ("density", "sound_speed", "absorption_exponent")
    ] + [layer.tissue.attenuation.value for layer in model.path]


def thermal_constants(model):
    return [
        getattr(layer.tissue, name).value
        for layer in model.layers[-2:]
        for name in ("conductivity", "specific_heat", "perfusion_rate")
    ]


# Relative steps: lesion edges sweep over Gauss points as heat or sound change, where the displacement has kinks in its
# second derivative; moduli move no edge, and times hardly matter in so short a push.
GROUPS = {
    "attenuation": (lambda model: list(model.liver.attenuation.coefficients), 1e-5),
    "Zener": (liver_laws, 2e-2),
    "layers": (layer_constants, 1e-5),
    "thermal": (thermal_constants, 1e-5),
}


def curve_of(model):
    """Displacement of every step over that of the first."""
    heating = simulate_heating(model, PROTOCOL, SETTINGS)
    displacement = stepwise_displacement(model, TEMPERATURES, PROTOCOL, SETTINGS, heating=heating)
    return displacement / displacement[0]


@pytest.fixture(scope="module")
def value():
    return jax.jit(curve_of)


@pytest.fixture(scope="module")
def slopes():
    gradient = jax.jit(jax.grad(lambda model, point: curve_of(model)[point]))
    return [gradient(NUMBERS, jnp.asarray(point)) for point in range(len(TEMPERATURES))]


def changed(group, index, distance):
    where, _ = GROUPS[group]
    if group == "attenuation":
        moved = NUMBERS.liver.attenuation.coefficients.at[index].add(distance)
        return eqx.tree_at(lambda model: model.liver.attenuation.coefficients, NUMBERS, moved)
    return eqx.tree_at(lambda model: where(model)[index], NUMBERS, where(NUMBERS)[index] + distance)


@pytest.mark.slow
@pytest.mark.parametrize("group", GROUPS)
def test_every_point_to_every_constant(value, slopes, group):
    """Fourth-order central differences; 1e-5 of the constant's largest effect on any point of the curve."""
    where, step = GROUPS[group]
    for index, constant in enumerate(where(NUMBERS)):
        ours = np.array([where(each)[index] for each in slopes])
        # A coefficient's step changes the attenuation by `step` of itself.
        size = step * 100.0 / 65.0**index if group == "attenuation" else step * float(constant)
        near, far = (value(changed(group, index, d)) - value(changed(group, index, -d)) for d in (size, 2.0 * size))
        central = np.asarray(8.0 * near - far) / (12.0 * size)
        # Rounding of the values, 1e-14, over the step.
        rounding = 1e-13 / size
        largest = np.max(np.abs(central))
        np.testing.assert_allclose(ours, central, rtol=0.0, atol=1e-5 * largest + rounding, err_msg=f"{index}")
