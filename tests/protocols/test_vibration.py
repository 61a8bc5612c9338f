"""Steady motion in liver: gradients, Fourier series, the lesion, and meshes that resolve the waves."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import (
    AbsorbingLayer,
    InputError,
    Layer,
    SineIntensity,
    SinePressure,
    Square,
    discretise,
    read_experiment,
    simulate_heating,
)
from arfjax.mechanics.material.viscoelastic import ConstrainedModulus
from arfjax.protocols.vibration import (
    VibrationSettings,
    resolving,
    vibrate,
    vibration_layer_error,
    vibration_mesh,
)
from tests.checks import assert_gradient_of_each_leaf

EXPERIMENT = Path(__file__).parents[2] / "examples" / "suomi2016.toml"
DESCRIBED = read_experiment(EXPERIMENT)
PAPERS = DESCRIBED.model()
# Water and liver alone: every layer more takes as long again to compile.
MODEL = dataclasses.replace(PAPERS, path=(Layer(PAPERS.path[0].tissue, PAPERS.liver_depth),))
PROTOCOL = DESCRIBED.stepwise()
SETTINGS = discretise(MODEL, refinement=0.4)
COARSE = VibrationSettings(element=0.8e-3, coarsest=4e-3, n_instants=41, layer=AbsorbingLayer(growth=2.0))


@pytest.fixture(scope="module")
def heating():
    return eqx.filter_jit(lambda model: simulate_heating(model, PROTOCOL, SETTINGS))(MODEL)


@pytest.fixture(scope="module")
def shaken(heating):
    """Steady motion at 65 degC as a function of model and modulation."""

    def run(modulation, model=MODEL, settings=COARSE):
        return eqx.filter_jit(
            lambda model, modulation: vibrate(
                model,
                65.0,
                PROTOCOL,
                SETTINGS,
                heating=heating,
                frequency=50.0,
                modulation=modulation,
                vibration=settings,
            )
        )(model, modulation)

    return run


@pytest.fixture(scope="module")
def of_intensity(shaken):
    return shaken(SineIntensity())


def test_one_harmonic_is_what_its_phasor_says(of_intensity):
    """And the force is the strongest at time 0; the tissue lags by less than half a period."""
    amplitude = complex(of_intensity.focal_amplitude[0])
    assert of_intensity.harmonic == (1,) and float(of_intensity.left_out) == 0.0
    np.testing.assert_allclose(of_intensity.peak_to_peak, 2.0 * abs(amplitude), rtol=1e-12)
    turn = 2.0 * np.pi * 50.0 * np.asarray(of_intensity.time)
    course = np.real(amplitude * np.exp(1j * turn))
    np.testing.assert_allclose(of_intensity.focal_displacement, course, atol=1e-12 * abs(amplitude))
    np.testing.assert_allclose(of_intensity.focal_force, 0.5 + 0.5 * np.cos(turn), atol=1e-12)
    assert -np.pi < np.angle(amplitude) < 0.0


def test_the_map_has_the_focus_in_it(of_intensity):
    mesh = vibration_mesh(SETTINGS, COARSE)
    row = int(np.argmin(np.abs(of_intensity.z - SETTINGS.focus)))
    assert of_intensity.peak_to_peak_map.shape == (len(mesh.node_r), len(mesh.node_z))
    np.testing.assert_allclose(of_intensity.peak_to_peak_map[0, row], of_intensity.peak_to_peak, rtol=1e-9)
    assert (of_intensity.z[0], of_intensity.z[-1]) == pytest.approx((MODEL.liver_depth, MODEL.liver_depth + 40e-3))


def test_motion_goes_with_the_force(shaken, of_intensity):
    """Half the depth: c_1 falls from 1/2 to 1/3; twice the power: all of it doubles."""
    shallow = shaken(SineIntensity(0.5))
    np.testing.assert_allclose(shallow.focal_amplitude, of_intensity.focal_amplitude * (1 / 3) / (1 / 2), rtol=1e-9)
    drive = dataclasses.replace(MODEL.drive, acoustic_power=2.0 * MODEL.drive.acoustic_power)
    loud = shaken(SineIntensity(), dataclasses.replace(MODEL, drive=drive))
    np.testing.assert_allclose(loud.peak_to_peak, 2.0 * of_intensity.peak_to_peak, rtol=1e-9)


@pytest.mark.slow
def test_harmonics_are_those_of_the_modulation(shaken, of_intensity):
    """The fundamental's motion per force is the same in all; a square has no even ones at a duty cycle of one half."""
    pressure, square = (
        shaken(SinePressure()),
        shaken(Square(), settings=dataclasses.replace(COARSE, n_harmonics=5, n_instants=801)),
    )
    assert pressure.harmonic == (1, 2) and square.harmonic == (1, 3, 5)
    first = complex(of_intensity.focal_amplitude[0]) / 0.5
    np.testing.assert_allclose(complex(pressure.focal_amplitude[0]), 0.5 * first, rtol=1e-9)
    np.testing.assert_allclose(complex(square.focal_amplitude[0]), 2.0 / np.pi * first, rtol=1e-9)
    assert 0.0 < float(square.left_out) < 0.2 * float(square.peak_to_peak)
    spread = float(np.ptp(np.asarray(square.focal_displacement)))
    np.testing.assert_allclose(spread, square.peak_to_peak, rtol=1e-4)


@pytest.mark.slow
def test_gradient_of_the_peak_to_peak(heating):
    """To attenuation, power and every modulus: reverse mode is forward mode, and both the central difference."""
    liver, lesion = MODEL.liver.viscoelasticity, MODEL.lesion.viscoelasticity
    attenuation = MODEL.liver.attenuation
    constants = {
        "attenuation": attenuation.reference_value,
        "liver M_0": liver.relaxed_modulus.value,
        "liver M_inf - M_0": liver.branch_modulus.value,
        "liver tau": liver.relaxation_time.value,
        # Table 3's times a hundred: of a few Pa, a difference would be lost in rounding.
        "lesion M_0": 100.0 * lesion.relaxed_modulus.value,
        "lesion M_inf - M_0": lesion.branch_modulus.value,
        "lesion tau": lesion.relaxation_time.value,
    }

    def with_value(law, value):
        return dataclasses.replace(law, value=value)

    def peak_to_peak(values):
        changed_liver = dataclasses.replace(
            liver,
            relaxed_modulus=with_value(liver.relaxed_modulus, values["liver M_0"]),
            branch_modulus=with_value(liver.branch_modulus, values["liver M_inf - M_0"]),
            relaxation_time=with_value(liver.relaxation_time, values["liver tau"]),
        )
        changed_lesion = dataclasses.replace(
            lesion,
            relaxed_modulus=with_value(lesion.relaxed_modulus, values["lesion M_0"]),
            branch_modulus=with_value(lesion.branch_modulus, values["lesion M_inf - M_0"]),
            relaxation_time=with_value(lesion.relaxation_time, values["lesion tau"]),
        )
        model = dataclasses.replace(
            MODEL,
            liver=dataclasses.replace(
                MODEL.liver,
                attenuation=dataclasses.replace(attenuation, reference_value=values["attenuation"]),
                viscoelasticity=changed_liver,
            ),
            lesion=dataclasses.replace(MODEL.lesion, viscoelasticity=changed_lesion),
        )
        arguments = model, jnp.asarray(65.0), PROTOCOL, SETTINGS
        # One harmonic alone has no extremes to search, hence two.
        return (
            1e6
            * vibrate(
                *arguments, heating=heating, frequency=50.0, modulation=SinePressure(), vibration=COARSE
            ).peak_to_peak
        )

    assert_gradient_of_each_leaf(peak_to_peak, constants, step=3e-3)


@pytest.mark.slow
def test_reverse_mode_equals_forward_mode_through_the_heating():
    """The lesion's size included, which the attenuation changes by way of dose."""

    def peak_to_peak(value):
        law = dataclasses.replace(MODEL.liver.attenuation, reference_value=value)
        model = dataclasses.replace(MODEL, liver=dataclasses.replace(MODEL.liver, attenuation=law))
        heated = simulate_heating(model, PROTOCOL, SETTINGS)
        given = {"heating": heated, "frequency": 50.0, "modulation": SineIntensity(), "vibration": COARSE}
        return 1e6 * vibrate(model, jnp.asarray(65.0), PROTOCOL, SETTINGS, **given).peak_to_peak

    value = jnp.asarray(MODEL.liver.attenuation.reference_value)

    def both(value):
        return jax.grad(peak_to_peak)(value), jax.jvp(peak_to_peak, (value,), (jnp.ones(()),))[1]

    reverse, forward = jax.jit(both)(value)
    assert forward != 0.0
    np.testing.assert_allclose(reverse, forward, rtol=1e-10)


@pytest.mark.slow
def test_a_thin_layer_is_told(heating):
    def error(layer):
        settings = dataclasses.replace(COARSE, layer=layer)
        return float(
            eqx.filter_jit(
                lambda model: vibration_layer_error(
                    model, 65.0, PROTOCOL, SETTINGS, heating=heating, frequency=50.0, vibration=settings
                )
            )(MODEL)
        )

    assert error(AbsorbingLayer()) < 3e-3 < 0.02 < error(AbsorbingLayer(thickness=10e-3, strength=0.2))


def test_elements_resolve_the_waves():
    """A sixth of the wave of the last harmonic that counts, up to the fifth, and never above 1 mm."""
    speed = np.sqrt(2000.0 / (2.0 * 1.499) / 1060.0)  # unrelaxed, which 50 Hz is within a percent
    chosen = [
        resolving(MODEL, 40.0, SETTINGS, frequency=50.0, modulation=course)
        for course in (SineIntensity(), SinePressure(), Square(), Square(0.3))
    ]
    assert [each.coarsest for each in chosen[:2]] == [1e-3, 1e-3]
    for each in chosen[2:]:
        np.testing.assert_allclose(each.coarsest, speed / 250.0 / 6.0, rtol=1e-2)
        mesh = vibration_mesh(SETTINGS, each)
        assert max(np.diff(mesh.r_edges).max(), np.diff(mesh.z_edges).max()) <= 1.001 * each.coarsest
    few = resolving(MODEL, 40.0, SETTINGS, frequency=200.0, modulation=Square(), n_harmonics=1)
    np.testing.assert_allclose(few.coarsest, speed / 200.0 / 6.0, rtol=1e-2)


def test_waves_too_short_to_resolve_are_refused():
    soft = dataclasses.replace(MODEL, modulus_reading=ConstrainedModulus())
    with pytest.raises(InputError, match="lower the frequency"):
        resolving(soft, 40.0, SETTINGS, frequency=1000.0, modulation=Square())


def test_a_layer_too_wide_for_its_elements_is_refused():
    """Even ones of 1 mm over 100 km; the liver alone is small enough."""
    wide = AbsorbingLayer(thickness=1e5, growth=1.0)
    with pytest.raises(InputError, match="lower the frequency"):
        resolving(MODEL, 40.0, SETTINGS, frequency=50.0, modulation=SineIntensity(), layer=wide)


@pytest.mark.parametrize("changes", [{"element": 0.0}, {"element": 2e-3}, {"coarsest": np.inf}, {"n_instants": 1}])
def test_what_cannot_be_meant_is_refused(changes):
    with pytest.raises(InputError):
        VibrationSettings(**changes)
