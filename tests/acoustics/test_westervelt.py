"""The nonlinear march: Westervelt's equation by its Green's function, what it conserves, its order, limits, gradients.

The bowl is that of test_one_way: 64 mm across with a 20 mm hole, curvature 62.6 mm, at 1.1 MHz. Where the source does
not matter a focused Gaussian beam on a disc of 20 mm stands in, which needs few terms.
"""

import dataclasses
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.apodisation import Apodisation
from arfjax.acoustics.sources.gaussian import GaussianSource
from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.acoustics.variation import MediumVariation
from arfjax.laws import NormalisedPolynomial
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import Drive, FocusedBowl, PressureDrive
from tests.checks import assert_gradient_of_each_leaf, assert_order

BOWL = FocusedBowl(aperture_radius=32e-3, hole_radius=10e-3, focal_length=62.6e-3)
WATER = AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)
LIVER = AcousticMedium(1060.0, 1584.0, 4.0, 1.1, 7.2)
AXIS = np.zeros(1)
ALONG_RAY, ALONG_AXIS = ExactOneWay(), ExactOneWay(steepening_along_ray=False)
FROM_THE_PLANE = MarchSettings(n_harmonics=5, n_radial=200, start_plane=9.297e-3, steepens_from_source=False)
BEAM = GaussianSource(radius=4e-3, focal_length=25e-3)
SMALL = MarchSettings(n_harmonics=8, n_radial=96, domain_radius=20e-3)


def bowl_field(power, r, z, settings, diffraction=ALONG_RAY):
    """Pressure in water."""

    @jax.jit
    def solve(drive):
        return solve_field(
            BOWL, drive, [AcousticLayer(WATER, 0.1)], r=r, z=z, settings=settings, diffraction=diffraction
        ).pressure

    return np.asarray(solve(Drive(1.1e6, jnp.asarray(power))))


@functools.cache
def beam_solver(settings, diffraction, r, z, thickness):
    z = np.asarray(z)

    @eqx.filter_jit
    def solve(pressure, media):
        layers = [AcousticLayer(medium, each) for medium, each in zip(media, thickness, strict=True)]
        drive = PressureDrive(1.1e6, pressure)
        field = solve_field(BEAM, drive, layers, r=np.asarray(r), z=z, settings=settings, diffraction=diffraction)
        # The axial estimate is left out: it is a second march to compile.
        convergence = dataclasses.replace(field.convergence, axial=jnp.zeros(()))
        return dataclasses.replace(field, r=jnp.asarray(field.r), z=jnp.asarray(field.z), convergence=convergence)

    return solve


def beam_field(pressure, media, z, settings=SMALL, *, diffraction=ALONG_RAY, r=(0.0,), thickness=(0.06,)):
    return beam_solver(settings, diffraction, tuple(r), tuple(z), thickness)(jnp.asarray(pressure), media)


def relative(values, exact):
    return np.linalg.norm(np.asarray(values) - exact) / np.linalg.norm(exact)


def test_second_harmonic_is_the_volume_integral_of_westervelts_source():
    r"""At low power p_2(x) = -\int 2 beta omega^2 / (rho c^4) p_1^2 G dV with G = exp(-2 i k R) / (4 pi R).

    The march leaves out what sources beyond the point send back, which makes 0.6 %, and has the rest to 0.2 %. With
    steepening along the axis 6.8 % are missing.
    """
    spacing, start, focal = 0.1e-3, 9.297e-3, np.array([60e-3, 62e-3])
    z = start + spacing * (np.arange(857) + 0.5)
    r = spacing * (np.arange(340) + 0.5)
    settings = dataclasses.replace(FROM_THE_PLANE, n_harmonics=1)
    fundamental = bowl_field(1e-2, r, z, settings)[0]
    omega = 2.0 * np.pi * 1.1e6
    source = -2.0 * 3.5 * omega**2 / (1000.0 * 1482.0**4) * fundamental**2 * 2.0 * np.pi * r[:, None] * spacing**2
    distance = np.hypot(r[:, None, None], z[None, :, None] - focal)
    each = source[:, :, None] * np.exp(-2j * omega / 1482.0 * distance) / (4.0 * np.pi * distance)
    whole = each.sum(axis=(0, 1))
    forward = np.where(z[None, :, None] < focal, each, 0.0).sum(axis=(0, 1))
    ours = bowl_field(1e-2, AXIS, focal, FROM_THE_PLANE)[1, 0]
    np.testing.assert_allclose(np.abs(whole), [348.8, 452.7], rtol=1e-3)
    assert np.all(np.abs(ours - whole) < 8e-3 * np.abs(whole))
    np.testing.assert_allclose(np.abs(ours), np.abs(forward), rtol=2.5e-3)
    np.testing.assert_allclose(np.abs(ours), np.abs(whole), rtol=6.5e-3)
    along_axis = bowl_field(1e-2, AXIS, focal, FROM_THE_PLANE, ALONG_AXIS)[1, 0]
    np.testing.assert_allclose(np.abs(along_axis / forward), 0.935, atol=5e-3)


@pytest.mark.slow
def test_it_does_not_matter_where_the_march_starts_if_sound_steepens_from_the_source():
    settings = MarchSettings(n_harmonics=5, n_radial=200)
    focal = {}
    for start in (12e-3, 16e-3):
        for from_source in (True, False):
            own = dataclasses.replace(settings, start_plane=start, steepens_from_source=from_source)
            focal[start, from_source] = np.abs(bowl_field(1.0, AXIS, np.array([62e-3]), own)[:3, 0, 0])
    np.testing.assert_allclose(focal[12e-3, True], focal[16e-3, True], rtol=3e-3)
    assert focal[12e-3, False][1] / focal[16e-3, False][1] > 1.01
    assert focal[12e-3, True][1] > focal[12e-3, False][1]


STRONG = MarchSettings(n_harmonics=16, n_radial=128, domain_radius=20e-3)


def lost_power(medium, pressure, stop=40e-3):
    """Heat between the source's plane and `stop` by Gauss's rule for r and Simpson's for z, and the field."""
    basis = hankel_basis(STRONG.n_radial, STRONG.domain_radius)
    clean = basis.nodes < STRONG.sponge_start * STRONG.domain_radius
    z = np.linspace(0.0, stop, 161)
    field = beam_field(pressure, [medium], z, STRONG, r=basis.nodes[clean])
    across = 2.0 * np.pi * basis.weights[clean] @ np.asarray(heat_deposition(field))
    weight = np.full(161, 2.0)
    weight[1::2], weight[[0, -1]] = 4.0, 1.0
    return across @ weight * stop / 160.0 / 3.0, field


def test_the_power_that_a_beam_loses_is_its_heat():
    """In liver; the sponge takes 2e-4 of it. What is scattered does not heat, but all that a shock takes does."""
    for fraction, pressure in ((1.0, 4e6), (0.7, 2e6)):
        medium = dataclasses.replace(LIVER, absorption_fraction=jnp.asarray(fraction))
        heat, field = lost_power(medium, pressure)
        power = field.layer_power[0]
        np.testing.assert_allclose(heat, fraction * (power[0] - power[1]), rtol=6e-4)
        assert (field.convergence.shock_fraction > 0.1) == (fraction == 1.0)


def test_what_is_lost_at_an_unresolved_shock_is_heat_too():
    """In lossless water the sensor alone makes it."""
    heat, field = lost_power(dataclasses.replace(WATER, absorption_fraction=jnp.asarray(1.0)), 8e6)
    power = field.layer_power[0]
    assert power[0] - power[1] > 0.05 * power[0]
    np.testing.assert_allclose(heat, power[0] - power[1], rtol=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("diffraction", [ALONG_RAY, ALONG_AXIS])
def test_second_order_in_the_axial_step(diffraction):
    """With the dissipation of a shock active: 8 harmonics in water, past where a plane wave forms one."""
    steps = [40e-3 / n for n in (80, 160, 320)]
    end = {}
    for step in (*steps, 40e-3 / 960):
        settings = dataclasses.replace(SMALL, axial_step=step, sponge_strength=0.0)
        field = beam_field(6e6, [WATER], [40e-3], settings, diffraction=diffraction)
        end[step] = np.asarray(field.pressure[:4, 0, 0])
    assert field.convergence.shock_fraction > 0.02
    errors = [relative(end[step], end[40e-3 / 960]) for step in steps]
    assert_order(steps, errors, order=2)
    assert errors[-1] < 1e-3


def test_small_sound_is_linear():
    z = [20e-3, 40e-3]
    linear = beam_field(1.0, [LIVER], z, dataclasses.replace(SMALL, n_harmonics=1)).pressure[0, 0]
    field = beam_field(1.0, [LIVER], z)
    np.testing.assert_allclose(field.pressure[0, 0], linear, rtol=1e-9)
    strong = beam_field(1e3, [LIVER], z)
    # The second harmonic grows as the square.
    np.testing.assert_allclose(strong.pressure[1], 1e6 * field.pressure[1], rtol=1e-4)


@pytest.mark.slow
def test_checkpoints_change_nothing():
    results = []
    for every in (1, 3, 7):
        settings = dataclasses.replace(SMALL, steps_per_checkpoint=every, axial_step=1e-3)

        def heat(pressure, settings=settings):
            return jnp.sum(heat_deposition(beam_field(pressure, [LIVER], [20e-3, 25e-3], settings)))

        results.append(jax.jit(jax.value_and_grad(heat))(3e6))
    np.testing.assert_allclose(results[1], results[0], rtol=1e-12)
    np.testing.assert_allclose(results[2], results[0], rtol=1e-12)


RADII, DEPTHS = np.array([1e-3, 4e-3, 9e-3]), np.array([32e-3, 50e-3, 60e-3, 70e-3])


def focal(values):
    """Heat and a pressure at the focus, on the axis and beside it."""
    water = AcousticMedium(1000.0, values["water_speed"], 0.0, 2.0, 5.0)
    law = NormalisedPolynomial(4.0, values["polynomial"], unit="Np/m", source="none")
    liver = AcousticMedium(
        values["density"],
        values["sound_speed"],
        law.evaluate(values["temperature"]),
        values["exponent"],
        values["nonlinearity"],
        values["absorption_fraction"],
    )
    bowl = FocusedBowl(values["aperture_radius"], values["hole_radius"], values["focal_length"])
    # The drive's power makes up for what all amplitudes have in common, so that only one is told apart.
    amplitude = jnp.stack([jnp.ones(()), jnp.asarray(values["rim_amplitude"]), jnp.full((), 0.6)])
    source = RadiatingBowl(bowl, Apodisation((0.0, 20e-3, 33e-3), amplitude, values["phase"]))
    layers = [AcousticLayer(water, 0.034), AcousticLayer(liver, 0.05)]
    field = solve_field(
        source,
        Drive(1.1e6, values["power"]),
        layers,
        r=np.array([0.0, 1e-3]),
        z=np.array([62e-3]),
        settings=MarchSettings(n_harmonics=5, n_radial=144, axial_step=0.8e-3),
        variation=MediumVariation(RADII, DEPTHS, values["more_attenuation"], values["more_speed"]),
    )
    return jnp.sum(1e-7 * heat_deposition(field)) + jnp.sum(1e-13 * jnp.abs(field.pressure) ** 2)


@pytest.mark.slow
def test_gradient_through_the_nonlinear_march():
    """To the polynomial, the constants, their variation in the layer, and the source's shape and apodisation."""
    rng = np.random.default_rng(5)
    values = {
        "power": 20.0,
        "polynomial": np.array([100.0, 0.2, -1e-2]),
        "temperature": 55.0,
        "sound_speed": 1584.0,
        "density": 1060.0,
        "exponent": 1.1,
        "nonlinearity": 7.2,
        "absorption_fraction": 0.8,
        "water_speed": 1482.0,
        "focal_length": 62.6e-3,
        "aperture_radius": 32e-3,
        "hole_radius": 10e-3,
        "rim_amplitude": 0.9,
        "phase": np.array([0.1, 0.0, 0.3]),
        "more_attenuation": rng.uniform(0.5, 2.0, (3, 4)),
        "more_speed": rng.uniform(5.0, 20.0, (3, 4)),
    }
    assert_gradient_of_each_leaf(focal, values, step=3e-5)


def test_power_through_interfaces():
    """What leaves one layer enters the next but for 4 Z1 Z2 / (Z1 + Z2)^2; of equal speed each angle passes alike."""
    heavy = AcousticMedium(1500.0, 1482.0, 0.0, 2.0, 5.0)
    for reflects, passed in ((True, 4.0 * 1.5 / 2.5**2), (False, 1.0)):
        settings = dataclasses.replace(SMALL, n_harmonics=1, reflects=reflects)
        field = beam_field(1e6, [WATER, heavy], [40e-3], settings, thickness=(20e-3, 30e-3))
        (entered, left), (beyond, _) = np.asarray(field.layer_power)
        np.testing.assert_allclose(beyond, passed * left, rtol=1e-12)
        np.testing.assert_allclose(left, entered, rtol=1e-4)
    # A wide Gaussian's power is p^2 S / (2 Z).
    np.testing.assert_allclose(entered, 1e12 * BEAM.area / (2.0 * 1.482e6), rtol=1e-2)
