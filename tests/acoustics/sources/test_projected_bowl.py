"""The projected bowl: its series against direct quadrature, other programs' source, power, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.power import plane_wave_power, power_through_plane
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.errors import InputError
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import Drive, FocusedBowl
from tests.acoustics.sources.problems import (
    APERTURE,
    BASIS,
    BOWL,
    COMPLEX_WAVENUMBER,
    DENSITY,
    FOCAL,
    FREQUENCY,
    HOLE,
    IMPEDANCE,
    WAVENUMBER,
    axial_wavenumber,
    marched,
    series,
)
from tests.checks import assert_gradient_of_each_leaf

SOURCE = ProjectedBowl(BOWL)


def test_it_is_a_spherical_wave_between_the_edge_rays():
    r = np.array([0.0, 8.6e-3, 8.8e-3, 20e-3, 31.9e-3, 32.1e-3])
    pressure = SOURCE.pressure_on_plane(2.0, jnp.asarray(WAVENUMBER - 3j), r, SOURCE.plane)
    height = np.sqrt(FOCAL**2 - APERTURE**2)
    distance = np.hypot(r, height)
    inside = (r > HOLE * height / np.sqrt(FOCAL**2 - HOLE**2)) & (r < APERTURE)
    lost = np.exp(-3.0 * (FOCAL - distance))
    expected = inside * 2.0 * FOCAL / distance * np.exp(1j * WAVENUMBER * (distance - FOCAL)) * lost
    np.testing.assert_allclose(pressure, expected, rtol=1e-12)
    np.testing.assert_allclose(SOURCE.plane, 8.797e-3, atol=1e-6)


def test_series_is_the_integral_over_the_ring():
    inner, outer = (float(edge) for edge in SOURCE.extent(np.inf))
    r, dr = np.linspace(inner, outer, 40001, retstep=True)
    simpson = np.ones_like(r)
    simpson[1:-1:2], simpson[2:-1:2] = 4.0, 2.0
    pressure = np.asarray(SOURCE.pressure_at(1.0, COMPLEX_WAVENUMBER, jnp.asarray(r)))
    direct = BASIS.evaluation_matrix(r).T @ (simpson * dr / 3.0 * r * pressure) / BASIS.norms
    np.testing.assert_allclose(series(SOURCE), direct, rtol=0.0, atol=1e-10)


@pytest.fixture(scope="module")
def fine():
    return hankel_basis(900, 62e-3)


def test_more_terms_leave_the_field_as_it_is(fine):
    distance, r = np.array([3e-3, 15e-3]), np.array([0.0, 3e-3])
    np.testing.assert_allclose(
        marched(series(SOURCE), distance, r, step=1e-3),
        marched(series(SOURCE, fine), distance, r, fine, step=1e-3),
        rtol=0.0,
        atol=2e-5,
    )


def test_it_starts_as_the_stored_field_of_another_code(fine):
    # Axial magnitudes [Pa] of the reference case at 50 W, source pressure as below: from Bessel series of 900 terms,
    # 0.168 mm apart from the rim's plane on. (A sponge of another strength is felt from there on, 1e-4 and growing.)
    coefficients = 209135.8 * series(ProjectedBowl(BOWL, fade_grazing=True), fine)
    np.testing.assert_allclose(np.abs(coefficients.sum()), 7.15655688, rtol=1e-6)
    axis = marched(coefficients, np.array([8.96505e-3 - 8.79703e-3]), np.zeros(1), fine)
    np.testing.assert_allclose(np.abs(axis), 5590.2044, rtol=1e-4)


def test_source_pressure_of_the_simulator():
    amplitude = series(ProjectedBowl(BOWL, fade_grazing=True))
    power = plane_wave_power(amplitude[None], BASIS, IMPEDANCE)[0]
    np.testing.assert_allclose(np.sqrt(50.0 / power), 209135.8, rtol=2e-4)


def test_power_is_that_of_the_cap_less_what_the_edges_lose():
    drive = Drive(FREQUENCY, 50.0)
    amplitude = drive.source_pressure(SOURCE, IMPEDANCE) * series(SOURCE)
    power = power_through_plane(amplitude[None], axial_wavenumber(), BASIS, DENSITY, jnp.asarray([FREQUENCY]))
    np.testing.assert_allclose(power, 50.0 * (1.0 - 0.0093), rtol=2e-4)


def test_power_does_not_depend_on_the_plane():
    frequency = jnp.asarray([FREQUENCY])
    for plane in (5e-3, 20e-3):
        amplitude = series(ProjectedBowl(BOWL, plane))[None]
        power = power_through_plane(amplitude, axial_wavenumber(), BASIS, DENSITY, frequency)
        np.testing.assert_allclose(power, BOWL.area / (2.0 * IMPEDANCE), rtol=0.015)


def test_focus_is_nearly_that_of_the_true_bowl():
    z, r = np.array([60e-3, 62.6e-3, 65e-3]), np.array([0.0, 0.5e-3])
    projected = marched(series(SOURCE), z - SOURCE.plane, r)
    true = marched(series(RadiatingBowl(BOWL)), z - 12e-3, r)
    np.testing.assert_allclose(projected, true, rtol=0.0, atol=0.02 * np.abs(true).max())


def test_a_batch_of_bowls_on_one_plane():
    lengths = jnp.array([60e-3, 62.6e-3, 65e-3])

    def coefficients(focal):
        return ProjectedBowl(FocusedBowl(APERTURE, HOLE, focal), 9e-3).series(1.0, COMPLEX_WAVENUMBER, BASIS)

    batch = jax.jit(jax.vmap(coefficients))(lengths)
    np.testing.assert_allclose(batch[1], series(ProjectedBowl(BOWL, 9e-3)), rtol=0.0, atol=1e-11)


def test_single_precision():
    wanted = series(SOURCE)
    with jax.enable_x64(False):
        source = ProjectedBowl(BOWL, SOURCE.plane)
        got = source.series(1.0, jnp.asarray(WAVENUMBER, dtype=jnp.complex64), BASIS)
        assert got.dtype == jnp.complex64
    assert np.linalg.norm(np.asarray(got) - wanted) < 2e-5 * np.linalg.norm(wanted)


def test_gradient_in_each_dimension_and_the_wavenumber():
    def on_axis(parameters):
        *dimensions, wavenumber = parameters
        source = ProjectedBowl(FocusedBowl(*dimensions), 9e-3, fade_grazing=True)
        amplitude = source.series(1.0, wavenumber - 1j, BASIS)
        return jnp.sum(jnp.abs(amplitude) ** 2 * jnp.asarray(BASIS.norms))

    assert_gradient_of_each_leaf(on_axis, (APERTURE, HOLE, FOCAL, WAVENUMBER), step=3e-6)


def test_gradient_on_the_plane_is_finite_at_every_radius():
    def total(dimensions):
        source = ProjectedBowl(FocusedBowl(*dimensions), 9e-3)
        pressure = source.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, np.array([0.0, 20e-3, 50e-3]), 9e-3)
        return jnp.sum(jnp.abs(pressure) ** 2)

    gradient = jax.grad(total)(tuple(map(jnp.asarray, (APERTURE, HOLE, FOCAL))))
    assert np.all(np.isfinite(gradient))


def test_a_plane_not_its_own_is_refused():
    with pytest.raises(InputError, match="given on the plane"):
        SOURCE.pressure_on_plane(1.0, COMPLEX_WAVENUMBER, np.zeros(1), 12e-3)


def test_a_traced_bowl_needs_a_plane():
    with pytest.raises(InputError, match="`plane`"):
        jax.jit(lambda aperture: ProjectedBowl(FocusedBowl(aperture, HOLE, FOCAL)).area)(APERTURE)


@pytest.mark.parametrize(("aperture", "plane"), [(32e-3, 70e-3), (FOCAL, 9e-3)])
def test_what_cannot_be_projected_is_refused(aperture, plane):
    with pytest.raises(InputError, match="cannot be projected"):
        ProjectedBowl(FocusedBowl(aperture, HOLE, FOCAL), plane).check()
