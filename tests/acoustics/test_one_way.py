"""The linear march against O'Neil's formula and the Rayleigh integral, its invariants, transforms and gradients.

The bowl throughout: 64 mm across with a 20 mm hole, curvature 62.6 mm, at 1.1 MHz.
"""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.absorption import complex_wavenumber
from arfjax.acoustics.diffraction import Pade11, Pade12, Parabolic
from arfjax.acoustics.intensity import intensity
from arfjax.acoustics.layers import AcousticLayer, transmission
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.errors import InputError
from arfjax.exact.oneil import axial_pressure
from arfjax.media import AcousticMedium
from arfjax.transducer import Drive, FocusedBowl
from tests.checks import assert_gradient_of_each_leaf

BOWL = FocusedBowl(aperture_radius=32e-3, hole_radius=10e-3, focal_length=62.6e-3)
DRIVE = Drive(frequency=1.1e6, acoustic_power=50.0)
WATER = AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)
LIVER = AcousticMedium(1060.0, 1584.0, 4.0, 1.0, 7.2)
SOURCE_PRESSURE = 217114.0
WAVENUMBER = 2.0 * np.pi * 1.1e6 / 1482.0
AXIS = np.array([0.0])
# A linear field needs no more terms than these; tests that compare runs with each other use them for speed.
COARSE = MarchSettings(n_radial=144)
FROM_THE_RIM = MarchSettings(start_plane=10.2e-3)


def axis_in_water(z, medium=WATER, **options):
    solve = eqx.filter_jit(lambda drive: solve_field(BOWL, drive, [AcousticLayer(medium, 0.1)], r=AXIS, z=z, **options))
    return np.asarray(solve(DRIVE).pressure[0, 0])


def test_source_pressure_of_the_reference_case():
    np.testing.assert_allclose(DRIVE.source_pressure(BOWL, 1.482e6), SOURCE_PRESSURE, atol=0.5)


def test_axis_in_water_is_oneils():
    z = np.arange(55e-3, 70e-3, 0.05e-3)
    pressure = axis_in_water(z)
    exact = axial_pressure(BOWL, z, wavenumber=WAVENUMBER, source_pressure=217114.2)
    np.testing.assert_allclose(np.abs(pressure).max(), np.abs(exact).max(), rtol=5e-5)
    assert np.linalg.norm(pressure - exact) < 5e-5 * np.linalg.norm(exact)  # phase included


def test_tabulated_magnitudes_in_water():
    z = np.array([20.0, 30.0, 40.0, 50.0, 55.0, 60.0, 62.1, 62.6, 65.0, 70.0, 80.0, 90.0]) * 1e-3
    expected = [0.9052, 3.7012, 2.5064, 9.8598, 9.2537, 34.7070, 37.4132, 37.2771, 33.2092, 15.4893, 5.9212, 2.2457]
    # Edge waves that the domain's radius cuts off reach the axis near the bowl only.
    tolerance = np.where(z < 25e-3, 0.15, np.where(z < 45e-3, 0.05, 5e-3))
    error = np.abs(np.abs(axis_in_water(z)) / SOURCE_PRESSURE - expected)
    assert np.all(error < tolerance), error


@pytest.mark.parametrize(
    ("diffraction", "peak", "shift", "norm"),
    [
        (Parabolic(), (0.063, 3e-3), (4.8e-3, 0.5e-3), (0.51, 0.02)),
        (Pade11(), (0.011, 1.5e-3), (0.4e-3, 0.15e-3), (0.047, 8e-3)),
        (Pade12(), (0.0003, 1.5e-3), (0.1e-3, 0.15e-3), (0.008, 6e-3)),
    ],
)
def test_errors_of_the_approximate_operators_are_those_known(diffraction, peak, shift, norm):
    """Peak, its position and L2 of magnitude from 55 to 70 mm, each as (value, tolerance), against O'Neil.

    The values are finite-difference marches from a projected source on the rim plane. That source alone makes -0.1 %,
    0.1 mm and 0.5 %; steps of a tenth of a wavelength add 0.1 % to the peak and 0.5 % to the L2 of Pade11. Ours start
    from the true bowl's field a wavelength past the rim, so that 3 % of the path is free of error.
    """
    z = np.arange(55e-3, 70.001e-3, 0.1e-3)
    pressure = np.abs(axis_in_water(z, diffraction=diffraction, settings=FROM_THE_RIM))
    exact = np.abs(axial_pressure(BOWL, z, wavenumber=WAVENUMBER, source_pressure=217114.2))
    np.testing.assert_allclose(pressure.max() / exact.max() - 1.0, peak[0], atol=peak[1])
    np.testing.assert_allclose(z[np.argmax(pressure)] - z[np.argmax(exact)], shift[0], atol=shift[1])
    np.testing.assert_allclose(np.linalg.norm(pressure - exact) / np.linalg.norm(exact), norm[0], atol=norm[1])


def test_lossy_axis_is_the_rayleigh_integral_with_complex_wavenumber():
    medium = AcousticMedium(1000.0, 1482.0, 8.0, 1.1, 5.0)
    z = np.array([55e-3, 60e-3, 62e-3, 65e-3, 70e-3])
    wavenumber = complex(complex_wavenumber(medium, jnp.asarray([1.1e6]))[0])
    nodes, weights = np.polynomial.legendre.leggauss(400)
    start, stop = np.arcsin(10.0 / 62.6), np.arcsin(32.0 / 62.6)
    angle = (0.5 * (start + stop) + 0.5 * (stop - start) * nodes)[None, :]
    distance = np.hypot(62.6e-3 * np.sin(angle), z[:, None] - 62.6e-3 * (1.0 - np.cos(angle)))
    ring = 62.6e-3**2 * np.sin(angle) * 0.5 * (stop - start) * weights[None, :]
    direct = 1j * wavenumber.real * np.sum(ring * np.exp(-1j * wavenumber * distance) / distance, axis=1)
    np.testing.assert_allclose(
        axis_in_water(z, medium), direct * 217114.2, rtol=0.0, atol=5e-5 * SOURCE_PRESSURE * np.abs(direct).max()
    )


def test_result_does_not_depend_on_the_step():
    z = np.array([55e-3, 62.1e-3, 70e-3])
    whole, half = (
        axis_in_water(z, settings=MarchSettings(n_radial=144, axial_step=step)) for step in (0.34e-3, 0.17e-3)
    )
    np.testing.assert_allclose(whole, half, rtol=0.0, atol=1e-5 * np.abs(half).max())


def test_result_does_not_depend_on_the_positions_asked_for():
    few, many = np.array([40e-3, 62e-3]), np.array([12e-3, 13.37e-3, 40e-3, 51.23e-3, 51.24e-3, 62e-3])
    pressure = axis_in_water(many, settings=COARSE)
    np.testing.assert_allclose(pressure[[2, 5]], axis_in_water(few, settings=COARSE), rtol=1e-4)


def test_an_interface_multiplies_by_the_transmission_coefficient():
    # Same speed, other density: the field beyond is that of one medium times 2 Z2 / (Z1 + Z2).
    heavy = AcousticMedium(1500.0, 1482.0, 0.0, 2.0, 5.0)
    z = np.array([39.9e-3, 40e-3, 62e-3])

    @jax.jit
    def pressure(second):
        layers = [AcousticLayer(WATER, 0.04), AcousticLayer(second, 0.05)]
        return solve_field(BOWL, DRIVE, layers, r=np.array([0.0, 1e-3]), z=z, settings=COARSE).pressure[0]

    ratio = np.asarray(pressure(heavy) / pressure(WATER))
    np.testing.assert_allclose(transmission(WATER, heavy), 1.2, rtol=1e-14)
    np.testing.assert_allclose(ratio, np.broadcast_to([1.0, 1.2, 1.2], (2, 3)), rtol=1e-11)


def test_cutting_a_medium_into_layers_changes_nothing():
    z = np.array([50e-3, 62e-3])
    layers = [AcousticLayer(WATER, 0.034), AcousticLayer(WATER, 0.0021), AcousticLayer(WATER, 0.05)]
    cut = solve_field(BOWL, DRIVE, layers, r=AXIS, z=z, settings=COARSE).pressure[0, 0]
    whole = axis_in_water(z, settings=COARSE)
    np.testing.assert_allclose(cut, whole, rtol=0.0, atol=1e-5 * np.abs(whole).max())


def test_media_along_z():
    layers = [AcousticLayer(WATER, 0.034), AcousticLayer(LIVER, 0.05)]
    field = solve_field(BOWL, DRIVE, layers, r=AXIS, z=np.array([20e-3, 34e-3, 84e-3]), settings=COARSE)
    np.testing.assert_allclose(field.density, [1000.0, 1060.0, 1060.0])
    np.testing.assert_allclose(field.sound_speed, [[1482.0, 1584.0, 1584.0]])
    np.testing.assert_allclose(field.attenuation, [[[0.0, 4.4, 4.4]]])
    np.testing.assert_allclose(field.frequency, [1.1e6])


def focal_intensity(parameters):
    layers = [
        AcousticLayer(WATER, 0.034),
        AcousticLayer(
            AcousticMedium(1060.0, parameters["sound_speed"], parameters["attenuation"], parameters["exponent"], 7.2),
            0.06,
        ),
    ]
    bowl = FocusedBowl(parameters["aperture_radius"], parameters["hole_radius"], parameters["focal_length"])
    drive = Drive(1.1e6, parameters["power"])
    field = solve_field(bowl, drive, layers, r=np.array([0.0, 1e-3]), z=np.array([62e-3]), settings=COARSE)
    return 1e-7 * (intensity(field)[0, 0, 0] + intensity(field)[0, 1, 0])


PARAMETERS = {
    "attenuation": 4.0,
    "sound_speed": 1584.0,
    "exponent": 1.0,
    "power": 50.0,
    "focal_length": 62.6e-3,
    "aperture_radius": 32e-3,
    "hole_radius": 10e-3,
}


def test_gradient_of_focal_intensity_in_each_parameter():
    assert_gradient_of_each_leaf(focal_intensity, PARAMETERS, step=1e-5)


def test_gradient_is_finite_in_a_lossless_medium():
    gradient = jax.jit(jax.grad(lambda value: focal_intensity(PARAMETERS | {"attenuation": value})))(0.0)
    assert np.isfinite(gradient)
    assert gradient < 0.0


def test_a_batch_over_attenuation_equals_a_loop():
    def pressure(attenuation):
        liver = AcousticMedium(1060.0, 1584.0, attenuation, 1.0, 7.2)
        layers = [AcousticLayer(WATER, 0.034), AcousticLayer(liver, 0.05)]
        return solve_field(BOWL, DRIVE, layers, r=np.array([0.0, 2e-3]), z=np.array([62e-3]), settings=COARSE).pressure

    attenuations = jnp.asarray([0.0, 4.0, 10.0])
    loop = jnp.stack([jax.jit(pressure)(attenuation) for attenuation in attenuations])
    np.testing.assert_allclose(jax.jit(jax.vmap(pressure))(attenuations), loop, rtol=1e-11)


def test_single_precision_agrees():
    z = np.linspace(55e-3, 70e-3, 31)
    double = axis_in_water(z)
    with jax.enable_x64(False):
        single = axis_in_water(z)
    assert single.dtype == np.complex64
    np.testing.assert_allclose(single, double, rtol=0.0, atol=1e-4 * np.abs(double).max())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"bowl": FocusedBowl(32e-3, 33e-3, 62.6e-3)}, "hole_radius < aperture_radius"),
        ({"bowl": FocusedBowl(32e-3, -1e-3, 62.6e-3)}, "0 <= hole_radius"),
        ({"bowl": FocusedBowl(32e-3, 10e-3, 30e-3)}, "<= focal_length"),
        ({"bowl": FocusedBowl(10e-3, 0.0, np.inf)}, "must be finite .m., got inf. A flat disc is a `Piston`"),
        ({"bowl": ProjectedBowl(FocusedBowl(10e-3, 0.0, np.inf), plane=12e-3)}, "A flat disc is a `Piston`"),
        ({"bowl": FocusedBowl(40e-3, 10e-3, 62.6e-3)}, "where the sponge begins"),
        ({"bowl": FocusedBowl(32e-3, 10e-3, 40e-3)}, "foremost point"),
        ({"z": np.array([10e-3, 60e-3])}, "start plane"),
        ({"z": np.array([60e-3, 101e-3])}, "end of the last layer"),
        ({"z": np.array([60e-3, 50e-3])}, "ascending"),
        ({"z": np.array([])}, "ascending"),
        ({"r": np.array([0.0, 40e-3])}, "where the sponge begins"),
        ({"r": np.array([-1e-3])}, "between 0"),
        ({"layers": []}, "positive thicknesses"),
        ({"layers": [AcousticLayer(WATER, 0.1), AcousticLayer(WATER, 0.0)]}, "positive thicknesses"),
        ({"layers": [AcousticLayer(WATER, 0.01), AcousticLayer(WATER, 0.09)]}, "inside the first layer"),
        ({"settings": MarchSettings(n_radial=80)}, "n_radial"),
        ({"settings": MarchSettings(n_quadrature=100)}, "n_quadrature"),
        ({"drive": Drive(5e6, 50.0)}, "does not resolve"),
        ({"drive": Drive(1.1e6, np.nan)}, "not finite: `acoustic_power`"),
        ({"drive": Drive(1.1e6, np.inf)}, "not finite: `acoustic_power` is inf"),
        ({"drive": Drive(1.1e6, -50.0)}, "`acoustic_power` must not be negative"),
        ({"drive": Drive(0.0, 50.0)}, "`frequency` must be positive"),
        ({"drive": Drive(np.inf, 50.0)}, "not finite: `frequency`"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, sound_speed=0.0), 0.1)]}, "`sound_speed` must be pos"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, sound_speed=np.inf), 0.1)]}, "`sound_speed` is inf"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, density=-1e3), 0.1)]}, "`density` must be positive"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, attenuation=-5.0), 0.1)]}, "`attenuation` must not be"),
        ({"drive": Drive(1.1, 50.0)}, "`frequency` must not be below 10000 .Hz., got 1.1. Megahertz"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, density=1.0), 0.1)]}, "`density` must not be below 100"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, absorption_fraction=50.0), 0.1)]}, "A percentage"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, absorption_fraction=-1.0), 0.1)]}, "absorption_fraction"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, absorption_exponent=3.0), 0.1)]}, "not above 2"),
        ({"layers": [AcousticLayer(dataclasses.replace(WATER, absorption_exponent=-1.0), 0.1)]}, "absorption_exponent"),
        ({"bowl": FocusedBowl(32e-3, np.nan, 62.6e-3)}, "not finite"),
        ({"layers": [AcousticLayer(WATER, 0.1), AcousticLayer(WATER, np.nan)]}, "positive thicknesses"),
        ({"z": np.array([12e-3])}, "beyond the start plane"),
        ({"z": np.array([40e-3, np.nan])}, "ascending"),
    ],
)
def test_impossible_input_is_refused(changes, message):
    arguments = {"bowl": BOWL, "drive": DRIVE, "layers": [AcousticLayer(WATER, 0.1)], "r": AXIS, "z": np.array([0.06])}
    arguments |= changes
    with pytest.raises(InputError, match=message):
        solve_field(arguments.pop("bowl"), arguments.pop("drive"), arguments.pop("layers"), **arguments)


@pytest.mark.parametrize(
    "changes",
    [{"axial_step": 0.0}, {"axial_step": -1e-3}, {"axial_step": 0.34}, {"n_radial": 0}, {"n_harmonics": 2}]
    + [{"start_plane": np.nan}, {"sponge_start": 0.98}, {"sponge_strength": np.nan}, {"domain_radius": 62.0}],
)
def test_settings_that_cannot_be_meant_are_refused(changes):
    with pytest.raises(InputError):
        MarchSettings(**changes)
