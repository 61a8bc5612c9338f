"""The bowl's field on a plane against direct quadrature of the Rayleigh integral over its surface."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl, as_source
from arfjax.errors import InputError
from arfjax.exact.oneil import axial_pressure
from arfjax.transducer import FocusedBowl
from tests.acoustics.sources.problems import (
    APERTURE,
    BOWL,
    COMPLEX_WAVENUMBER,
    FOCAL,
    HOLE,
    RADII,
    WAVENUMBER,
    bowl_profile,
    marched,
    rayleigh,
    series,
)

# Two rings with a silent one between; within each amplitude and phase vary.
KNOTS = np.array([10.0, 17.0, 17.0, 20.0, 20.0, 26.0, 32.0]) * 1e-3
AMPLITUDE = np.array([0.4, 1.0, 0.0, 0.0, 1.2, 1.0, 0.3])
PHASE = np.array([0.0, 0.6, 0.0, 0.0, -0.8, 1.5, 1.0])


@pytest.mark.parametrize("attenuation", [0.0, 5.0])
@pytest.mark.parametrize("plane", [11e-3, 12e-3, 40e-3])
def test_it_is_the_rayleigh_integral(plane, attenuation):
    wavenumber = WAVENUMBER - 1j * attenuation
    pressure = RadiatingBowl(BOWL).pressure_on_plane(1.0, jnp.asarray(wavenumber), RADII, plane)
    direct = [rayleigh(r, plane, wavenumber, bowl_profile()) for r in RADII]
    np.testing.assert_allclose(pressure, direct, rtol=0.0, atol=1e-9)


def test_apodised_it_is_the_weighted_rayleigh_integral():
    source = RadiatingBowl(BOWL, Apodisation(KNOTS, AMPLITUDE, PHASE))
    pressure = source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, 12e-3)
    direct = np.zeros(len(RADII), complex)
    for left in np.flatnonzero(np.diff(KNOTS)):
        ends = KNOTS[left : left + 2]

        def weight(ring, left=left, ends=ends):
            amplitude, phase = (np.interp(ring, ends, values[left : left + 2]) for values in (AMPLITUDE, PHASE))
            return amplitude * np.exp(1j * phase)

        profile = bowl_profile(weight, *ends)
        direct += [rayleigh(r, 12e-3, WAVENUMBER, profile, n=90) for r in RADII]
    np.testing.assert_allclose(pressure, direct, rtol=0.0, atol=1e-9)


def test_apodisation_of_one_changes_nothing():
    ones = RadiatingBowl(BOWL, Apodisation(KNOTS, np.ones(7), np.zeros(7)))
    plain = RadiatingBowl(BOWL)
    ones.check()
    fields = [source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, 12e-3) for source in (ones, plain)]
    np.testing.assert_allclose(*fields, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(ones.area, plain.area, rtol=1e-12)


def test_area_counts_the_square_of_the_amplitude():
    halves = Apodisation(np.array([10.0, 20.0, 20.0, 32.0]) * 1e-3, np.array([1.0, 1.0, 0.5, 0.5]), np.ones(4))
    inner, outer = FocusedBowl(20e-3, HOLE, FOCAL), FocusedBowl(APERTURE, 20e-3, FOCAL)
    np.testing.assert_allclose(RadiatingBowl(BOWL, halves).area, inner.area + 0.25 * outer.area, rtol=1e-12)


def test_steepening_length_counts_every_part_of_the_way_by_how_strong_the_wave_is_there():
    """A converging wave has F / s of its first pressure at s from the focus; on the bowl itself it has gone no way."""
    r, plane = np.array([0.0, 30e-3, np.sqrt(FOCAL**2 - 40e-3**2), 60e-3]), FOCAL - 40e-3
    ends = np.minimum(np.hypot(r, 40e-3), FOCAL)  # from the focus: 40 mm, 50 mm, the bowl, beyond it
    lengths = [quad(lambda s, end=end: end / s, end, FOCAL)[0] for end in ends]
    np.testing.assert_allclose(RadiatingBowl(BOWL).steepening_length(r, plane), lengths, rtol=1e-12, atol=1e-15)


def test_focus_is_oneils():
    z = np.array([60e-3, 62.1e-3, 65e-3])
    pressure = marched(series(as_source(BOWL)), z - 12e-3, np.zeros(1))[0]
    np.testing.assert_allclose(pressure, axial_pressure(BOWL, z, wavenumber=WAVENUMBER), rtol=5e-3)


def test_single_precision():
    wanted = RadiatingBowl(BOWL).pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, 12e-3)
    with jax.enable_x64(False):
        pressure = RadiatingBowl(BOWL).pressure_on_plane(1.0, COMPLEX_WAVENUMBER.astype("complex64"), RADII, 12e-3)
        assert pressure.dtype == jnp.complex64
    np.testing.assert_allclose(pressure, wanted, rtol=0.0, atol=5e-5)


def radiated(parameters):
    dimensions, wavenumber, attenuation, source_pressure, amplitude, phase = parameters
    source = RadiatingBowl(FocusedBowl(*dimensions), Apodisation(KNOTS, amplitude, phase))
    wavenumber = wavenumber - 1j * attenuation
    pressure = source.pressure_on_plane(source_pressure, wavenumber, RADII[:4], 12e-3, n_quadrature=220)
    return jnp.sum(jnp.abs(pressure) ** 2) + 1e3 * source.area


PARAMETERS = jax.tree.map(jnp.asarray, ((APERTURE, HOLE, FOCAL), WAVENUMBER, 1.0, 2.0, AMPLITUDE, PHASE))


@pytest.fixture(scope="module")
def value_and_gradient():
    return jax.jit(jax.value_and_grad(radiated))


def test_gradient_in_dimensions_wavenumber_pressure_amplitude_and_phase(value_and_gradient):
    # As `assert_gradient_of_each_leaf`, which would compile twice as much.
    leaves, structure = jax.tree.flatten(PARAMETERS)
    gradient = jax.tree.leaves(value_and_gradient(PARAMETERS)[1])
    forward = jax.jit(lambda direction: jax.jvp(radiated, (PARAMETERS,), (direction,))[1])
    for index, leaf in enumerate(leaves):
        pick = [leaf if other == index else jnp.zeros_like(value) for other, value in enumerate(leaves)]
        reverse = jnp.sum(gradient[index] * leaf)
        np.testing.assert_allclose(reverse, forward(structure.unflatten(pick)), rtol=1e-10)

        def along(length, pick=pick):
            moved = [value + length * change for value, change in zip(leaves, pick, strict=True)]
            return float(value_and_gradient(structure.unflatten(moved))[0])

        step = 3e-6 if index < 4 else 1e-3
        central = (8.0 * (along(step) - along(-step)) - along(2.0 * step) + along(-2.0 * step)) / (12.0 * step)
        np.testing.assert_allclose(reverse, central, rtol=1e-6, err_msg=str(index))


def test_gradient_is_finite_without_hole_and_loss(value_and_gradient):
    _, *others = PARAMETERS
    others[1] = jnp.asarray(0.0)
    _, gradient = value_and_gradient((tuple(map(jnp.asarray, (APERTURE, 0.0, FOCAL))), *others))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(gradient))


def test_a_plane_inside_the_bowl_gives_nan():
    pressure = RadiatingBowl(BOWL).pressure_on_plane(1.0, COMPLEX_WAVENUMBER, RADII, 8e-3)
    assert np.all(np.isnan(pressure))


@pytest.mark.parametrize("dimensions", [(32e-3, 40e-3, 62.6e-3), (32e-3, -1e-3, 62.6e-3), (70e-3, 0.0, 62.6e-3)])
def test_dimensions_that_are_no_bowl_are_refused(dimensions):
    with pytest.raises(InputError, match="a bowl needs"):
        RadiatingBowl(FocusedBowl(*dimensions)).check()


@pytest.mark.parametrize(
    ("radius", "amplitude", "message"),
    [
        ([10.0, 32.0], [1.0, 1.0], "Millimetres"),
        ([10e-3, 9e-3, 32e-3], [1.0] * 3, "must ascend"),
        ([10e-3, 20e-3, 20e-3, 20e-3, 32e-3], [1.0] * 5, "must ascend"),
        ([10e-3, 10e-3, 32e-3], [1.0] * 3, "cannot jump"),
        ([10e-3], [1.0], "two or more"),
        ([10e-3, np.nan], [1.0] * 2, "finite"),
        ([10e-3, 32e-3], [1.0] * 3, "3 values for 2"),
        ([10e-3, 32e-3], [1.0, np.nan], "not finite"),
        ([10e-3, 30e-3], [1.0, 1.0], "does not cover"),
    ],
)
def test_an_apodisation_that_cannot_be_meant_is_refused(radius, amplitude, message):
    with pytest.raises(InputError, match=message):
        RadiatingBowl(BOWL, Apodisation(radius, np.array(amplitude), np.zeros(len(amplitude)))).check()
