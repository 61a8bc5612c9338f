"""Media that vary within a layer: slabs, a thin lens, what is kept, order, local values, gradients.

The bowl throughout is that of test_one_way: 64 mm across with a 20 mm hole, curvature 62.6 mm, at 1.1 MHz.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.acoustics.absorption import complex_wavenumber
from arfjax.acoustics.diffraction import ExactOneWay, Parabolic
from arfjax.acoustics.intensity import heat_deposition, intensity, radiation_force_density
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.march import Beam, march
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.variation import MediumVariation, step_factors
from arfjax.errors import InputError
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.transducer import Drive, FocusedBowl
from tests.checks import assert_gradient, assert_order

BOWL = FocusedBowl(aperture_radius=32e-3, hole_radius=10e-3, focal_length=62.6e-3)
DRIVE = Drive(frequency=1.1e6, acoustic_power=50.0)
WATER = AcousticMedium(1000.0, 1482.0, 0.0, 2.0, 5.0)
LIVER = AcousticMedium(1060.0, 1584.0, 4.0, 1.1, 7.2)
LAYERS = [AcousticLayer(WATER, 0.034), AcousticLayer(LIVER, 0.05)]
COARSE = MarchSettings(n_radial=144)
R = np.array([0.0, 1e-3])
Z = np.array([58e-3, 62e-3, 66e-3])
OMEGA = 2.0 * np.pi * 1.1e6
SPREAD = 4e-3  # m; of the heated region


def centres(spacing, start, stop):
    return np.arange(start + 0.5 * spacing, stop, spacing)


def heated(spacing=1e-3, attenuation=4.0, sound_speed=40.0):
    """A round region about the focus in which both constants grow; zero to rounding at the grid's ends."""
    r, z = centres(spacing, 0.0, 22e-3), centres(spacing, 38e-3, 82e-3)
    bump = np.exp(-((r[:, None] / SPREAD) ** 2) - ((z[None, :] - 60e-3) / SPREAD) ** 2)
    return MediumVariation(r, z, attenuation * bump, sound_speed * bump)


def uniform(front, back, attenuation=0.0, sound_speed=0.0):
    """The same change everywhere between two depths."""
    r, z = np.linspace(0.5e-3, 64e-3, 5), centres(0.2 * (back - front), front, back)
    return MediumVariation(r, z, jnp.full((5, 5), attenuation), jnp.full((5, 5), sound_speed))


@functools.cache
def solver(layers, settings, z, r, bowl, diffraction, positions):
    """Compiled once for all variations on the same positions."""

    @jax.jit
    def solve(values, layers):
        variation = None if values is None else MediumVariation(*map(np.asarray, positions), *values)
        each, where = dict(settings=settings, diffraction=diffraction), dict(r=np.asarray(r), z=np.asarray(z))
        return solve_field(bowl, DRIVE, list(layers), **where, **each, variation=variation)

    return solve


def field(variation, *, layers=LAYERS, settings=COARSE, z=Z, r=R, bowl=BOWL, diffraction=ExactOneWay()):  # noqa: B008
    values, positions = None, None
    if variation is not None:
        values = (variation.attenuation, variation.sound_speed)
        positions = (tuple(variation.r), tuple(variation.z))
    thicknesses = tuple(layer.thickness for layer in layers)
    return solver(thicknesses, settings, tuple(z), tuple(r), bowl, diffraction, positions)(values, layers)


FREQUENCY = jnp.asarray([1.1e6])
PLANES = np.linspace(40e-3, 80e-3, 11)


def beam(variation, step, *, diffraction=ExactOneWay(), medium=WATER):  # noqa: B008
    """Bessel series on the planes of a Gaussian beam that is focused on the last one; no sponge."""
    basis = hankel_basis(144, 62e-3)
    phase = OMEGA / 1482.0 * (np.hypot(basis.nodes, 40e-3) - 40e-3)
    start = basis.to_series @ np.exp(-((basis.nodes / 10e-3) ** 2) + 1j * phase)
    every = round(4e-3 / step)
    positions = np.linspace(PLANES[0], PLANES[-1], 10 * every + 1)

    @jax.jit
    def run():
        wavenumber, radial = complex_wavenumber(medium, FREQUENCY), jnp.asarray(basis.wavenumbers)
        kz, path = diffraction.axial_wavenumber(wavenumber, radial), diffraction.path(wavenumber.real, radial)
        marched = march(
            Beam(amplitude := jnp.asarray(start)[:, None], None if path is None else jnp.zeros_like(amplitude)),
            positions,
            np.arange(len(positions)) % every == 0,
            axial_wavenumber=kz,
            path=path,
            basis=basis,
            evaluation=jnp.eye(144),  # the coefficients themselves
            physical=lambda pressure, _: pressure,
            factors=step_factors(variation, medium, (0.0, 0.1), FREQUENCY, basis.nodes, positions),
        )
        return marched.pressure[..., 0]

    return basis, np.asarray(run())


def axis(variation, step, **options):
    """Pressure of that beam on the axis, in its own units."""
    return beam(variation, step, **options)[1].sum(axis=1)


def relative(values, reference):
    """Largest difference over the largest value."""
    return float(np.abs(np.asarray(values) - np.asarray(reference)).max() / np.abs(np.asarray(reference)).max())


def test_no_change_is_no_change():
    none, zero = field(None), field(heated(attenuation=0.0, sound_speed=0.0))
    for name in ("pressure", "density", "sound_speed", "attenuation"):
        np.testing.assert_allclose(getattr(zero, name), getattr(none, name), rtol=1e-12)


ALONG_AXIS = ExactOneWay(steepening_along_ray=False)


@pytest.mark.parametrize("diffraction", [ALONG_AXIS, Parabolic()])
def test_beyond_a_uniform_slab_the_field_is_multiplied_by_its_wavenumber(diffraction):
    """Exact for these operators, because a factor without r commutes with diffraction; dispersion included."""
    thickness, more_attenuation, more_speed = 8e-3, 3.0, 25.0
    slab = uniform(52e-3, 52e-3 + thickness, more_attenuation, more_speed)
    changed, plain = (beam(each, 0.4e-3, diffraction=diffraction, medium=LIVER)[1] for each in (slab, None))
    assert relative(changed[:4], plain[:4]) < 1e-12
    reference = 2.0 * np.pi * 1e6
    slowness = 1.0 / (1584.0 + more_speed) - 1.0 / 1584.0
    slowness += more_attenuation / reference * np.tan(0.55 * np.pi) * (1.1**0.1 - 1.0)
    expected = np.exp(-(more_attenuation * 1.1**1.1 + 1j * OMEGA * slowness) * thickness)
    assert relative(changed[5:], plain[5:] * expected) < 1e-9


@pytest.mark.parametrize(("attenuation", "sound_speed"), [(0.8, 0.0), (0.0, 7.92)])
def test_changing_a_whole_layer_is_another_layer(attenuation, sound_speed):
    """Against a layer of another medium (of equal impedance): 20 % of attenuation, half a percent of sound speed.

    What is missed is of second order in the change: a thousandth of it. Along the axis 9 percent are missed, the mean
    of 1 / cos over the bowl's solid angle, less one, being 8.4 percent.
    """
    other = AcousticMedium(
        LIVER.density * 1584.0 / (1584.0 + sound_speed), 1584.0 + sound_speed, 4.0 + attenuation, 1.1, 7.2
    )
    z = np.array([59.75e-3])
    for diffraction, expected, tolerance in ((ExactOneWay(), 0.0, 1e-3), (ALONG_AXIS, 0.091, 3e-3)):
        exact = field(None, layers=[LAYERS[0], AcousticLayer(other, 0.05)], z=z).pressure[0]
        plain = field(None, z=z).pressure[0]
        split = field(uniform(0.034, 0.084, attenuation, sound_speed), z=z, diffraction=diffraction).pressure[0]
        missed = np.asarray(exact - split)[0, 0] / np.asarray(exact - plain)[0, 0]
        np.testing.assert_allclose(np.abs(missed), expected, atol=tolerance)


def test_a_thin_lens_moves_the_field_as_fresnel_has_it():
    r"""Beyond a screen of phase k r^2 / (2 f) the parabolic field at the distance L is that without at L', scaled.

    1 / L' = 1 / L - 1 / f, p(r, L) = (L'/L) p_0(r L'/L, L') exp(-i k (r^2 / (2 L) - (r L'/L)^2 / (2 L') + L - L')).
    The whole pressure changes by 19 percent of its peak; 0.05 percent are left, where the lens ends (at 20 mm).
    """
    bowl, power, thickness, front, k = FocusedBowl(20e-3, 0.0, 62.6e-3), 2.5, 1e-3, 39.5e-3, OMEGA / 1482.0
    settings = MarchSettings(n_radial=144, axial_step=thickness)
    layers = [AcousticLayer(WATER, front), AcousticLayer(WATER, thickness), AcousticLayer(WATER, 0.05)]
    nodes = hankel_basis(144, 62e-3).nodes
    change = -0.5 * k * power * np.minimum(nodes, 20e-3) ** 2 / thickness
    speed = np.repeat((OMEGA / (k + change) - 1482.0)[:, None], 3, axis=1)
    lens = MediumVariation(nodes, front + thickness * np.array([1.0, 3.0, 5.0]) / 6.0, np.zeros(speed.shape), speed)
    r, z = np.array([0.0, 0.5e-3, 1e-3]), np.array([50e-3, 58e-3, 62e-3, 70e-3])
    screen = front + 0.5 * thickness
    distance = z - screen
    nearer = 1.0 / (1.0 / distance - power)
    with_lens = field(lens, layers=layers, settings=settings, z=z, r=r, bowl=bowl, diffraction=Parabolic()).pressure[0]
    # One march for all: the radii wanted at each distance lie next to each other.
    scaled = r[:, None] * (nearer / distance)[None, :]
    options = {"layers": layers, "settings": settings, "bowl": bowl, "diffraction": Parabolic()}
    every = field(None, z=screen + nearer, r=scaled.ravel(), **options).pressure[0]
    plain = np.asarray(every).reshape(3, 4, 4)[:, np.arange(4), np.arange(4)]
    bending = r[:, None] ** 2 / (2.0 * distance[None]) - scaled**2 / (2.0 * nearer[None])
    expected = (nearer / distance)[None] * plain * np.exp(-1j * k * (bending + (distance - nearer)[None]))
    assert relative(with_lens, expected) < 7e-4
    assert relative(field(None, z=z, r=r, **options).pressure[0], expected) > 0.18


@pytest.mark.parametrize("diffraction", [ExactOneWay(), ALONG_AXIS, Parabolic()])
def test_a_lossless_variation_keeps_what_its_operator_keeps(diffraction):
    """Along the axis the integral of |p|^2 over a plane, exactly; along the ray the power, to the order of the step."""
    basis, history = beam(heated(attenuation=0.0, sound_speed=-60.0), 0.4e-3, diffraction=diffraction)
    plain = beam(None, 0.4e-3, diffraction=diffraction)[1]
    assert relative(history, plain) > 0.1
    along_ray = diffraction == ExactOneWay()
    weight = np.sqrt(np.maximum((OMEGA / 1482.0) ** 2 - basis.wavenumbers**2, 0.0)) if along_ray else 1.0
    kept = np.sum(basis.norms * weight * np.abs(history) ** 2, axis=1)
    np.testing.assert_allclose(kept, kept[0], rtol=1e-4 if along_ray else 4e-7)


def test_second_order_in_the_axial_step():
    steps = [4e-3 / count for count in (4, 8, 16)]
    exact = axis(heated(), 4e-3 / 64)
    errors = [relative(axis(heated(), step), exact) for step in steps]
    assert_order(steps, errors, order=2)
    assert errors[-1] < 2e-4


def test_second_order_in_the_grid_of_the_variation():
    exact = axis(heated(0.1e-3), 0.5e-3)
    spacings = [2e-3, 1e-3, 0.5e-3]
    errors = [relative(axis(heated(spacing), 0.5e-3), exact) for spacing in spacings]
    assert_order(spacings, errors, order=2)


def test_local_values_are_second_order_in_the_grid_up_to_the_axis():
    r, z = np.linspace(0.0, 10e-3, 101), np.linspace(50e-3, 70e-3, 203)
    exact = 4.0 * np.exp(-((r[:, None] / SPREAD) ** 2) - ((z[None, :] - 60e-3) / SPREAD) ** 2)
    spacings = [1e-3, 0.5e-3, 0.25e-3]
    for some in (slice(None), slice(0, 1)):
        errors = [relative(heated(spacing).at((0.0, 0.1), r, z)[0][some], exact[some]) for spacing in spacings]
        assert_order(spacings, errors, order=2)


def test_values_between_centres():
    r, z = np.array([0.5e-3, 1.5e-3, 3.5e-3]), np.array([30e-3, 32e-3, 36e-3, 40e-3])
    values = 1.0 + 1e6 * r[:, None] ** 2 + 100.0 * z[None, :]
    variation = MediumVariation(r, z, values, 2.0 * values)
    attenuation, speed = variation.at(
        (0.0, 0.034), np.array([0.0, 0.25e-3, 1e-3, 4.4e-3, 4.6e-3]), np.array([28.9e-3, 29.1e-3, 31e-3, 33.9e-3])
    )
    np.testing.assert_allclose(speed, 2.0 * attenuation, rtol=1e-14)
    # In the layer from 0 to 34 mm: nothing before 29 mm, held from there to 30 mm and from 32 to 34 mm.
    along_z = np.array([0.0, 3.0, 3.1, 3.2])
    # At 1 mm halfway between 0.25 and 2.25; a parabola inside; the grid ends at 4.5 mm.
    across = np.array([0.0, 0.0625, 1.25, 12.25, 0.0])
    expected = np.where(along_z[None, :] > 0.0, 1.0 + across[:, None] + along_z[None, :], 0.0)
    expected[-1] = 0.0
    np.testing.assert_allclose(attenuation, expected, atol=1e-12)
    beyond = variation.at((0.034, 0.1), np.array([0.0]), np.array([34.1e-3, 38e-3, 41.9e-3, 42.1e-3]))
    np.testing.assert_allclose(beyond[0], [[4.6, 4.8, 5.0, 0.0]], atol=1e-12)
    assert variation.at((0.0, 0.03), r, z) is None
    assert variation.at((0.04, 0.041), r, np.array([40e-3])) is not None


def test_local_values_are_those_that_heat_and_push():
    z = np.array([50e-3, 60e-3])
    plain, hot = field(None, z=z), field(heated(0.25e-3), z=z)
    bump = np.exp(-((R[:, None] / SPREAD) ** 2) - ((z[None, :] - 60e-3) / SPREAD) ** 2)
    np.testing.assert_allclose(hot.attenuation[0], (4.0 + 4.0 * bump) * 1.1**1.1, rtol=2e-3)
    np.testing.assert_allclose(hot.sound_speed, 1584.0 + 40.0 * bump, rtol=1e-4)
    np.testing.assert_allclose(plain.attenuation, np.full((1, 2, 2), 4.0 * 1.1**1.1), rtol=1e-14)
    square = np.abs(np.asarray(hot.pressure[0])) ** 2
    local = np.asarray(hot.sound_speed)
    np.testing.assert_allclose(intensity(hot)[0], square / (2.0 * 1060.0 * local), rtol=1e-12)
    heat = np.asarray(hot.attenuation[0]) * square / (1060.0 * local)
    np.testing.assert_allclose(heat_deposition(hot), heat, rtol=1e-12)
    np.testing.assert_allclose(radiation_force_density(hot), heat / local, rtol=1e-12)


def test_faster_tissue_on_the_axis_spreads_the_beam_and_slower_gathers_it():
    """A hot core is a diverging lens where sound gets faster with heat (tissue), a gathering one where slower (fat)."""
    peak = {
        change: np.abs(axis(heated(sound_speed=change, attenuation=0.0), 0.4e-3)[PLANES < 65e-3]).max()
        for change in (-30.0, 0.0, 30.0)
    }
    assert peak[30.0] < peak[0.0] < peak[-30.0]


def focal_heat(values):
    r, z = np.array([1e-3, 4e-3, 9e-3]), np.array([32e-3, 50e-3, 60e-3, 70e-3])
    variation = MediumVariation(r, z, values["attenuation"], values["sound_speed"])
    result = solve_field(BOWL, DRIVE, LAYERS, r=R, z=np.array([62e-3]), settings=COARSE, variation=variation)
    return 1e-7 * jnp.sum(heat_deposition(result))


def coarse_values(rng):
    return {"attenuation": 2.0 + rng.normal(size=(3, 4)) ** 2, "sound_speed": 5.0 * rng.normal(size=(3, 4))}


def test_gradient_to_the_variation():
    assert_gradient(focal_heat, coarse_values(np.random.default_rng(0)), step=3e-4)


def test_gradient_is_finite_at_no_variation():
    gradient = jax.jit(jax.grad(focal_heat))(jax.tree.map(jnp.zeros_like, coarse_values(np.random.default_rng(0))))
    assert all(np.all(np.isfinite(leaf)) and np.any(leaf != 0.0) for leaf in gradient.values())


def test_a_batch_over_variations_equals_a_loop():
    rng = np.random.default_rng(1)
    cases = [jax.tree.map(jnp.asarray, coarse_values(rng)) for _ in range(3)]
    batch = jax.tree.map(lambda *leaves: jnp.stack(leaves), *cases)
    loop = [float(jax.jit(focal_heat)(case)) for case in cases]
    np.testing.assert_allclose(jax.jit(jax.vmap(focal_heat))(batch), loop, rtol=1e-11)


def test_single_precision_agrees():
    double = field(heated())
    with jax.enable_x64(False):
        single = field(heated())
    assert single.pressure.dtype == np.complex64
    assert single.attenuation.dtype == single.sound_speed.dtype == np.float32
    assert relative(single.pressure, double.pressure) < 1e-4


VALUES = np.zeros((2, 3))
TWO, THREE = np.array([1e-3, 2e-3]), np.array([50e-3, 60e-3, 70e-3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((TWO[::-1], THREE, VALUES, VALUES), "`r` of a variation must hold two or more ascending"),
        ((-TWO[::-1], THREE, VALUES, VALUES), "`r` of a variation must hold two or more ascending"),
        ((TWO[:1], THREE, VALUES[:1], VALUES[:1]), "`r` of a variation must hold two or more ascending"),
        ((TWO, THREE * np.array([1.0, np.nan, 1.0]), VALUES, VALUES), "`z` of a variation must hold"),
        ((TWO, THREE, VALUES.T, VALUES), r"`attenuation` of a variation has shape \(3, 2\)"),
        ((TWO, THREE, VALUES, VALUES[:, :2]), "`sound_speed` of a variation has shape"),
        ((TWO, THREE, VALUES + np.nan, VALUES), "`attenuation` of a variation holds values that are not finite"),
        ((TWO, THREE, VALUES, VALUES + np.inf), "`sound_speed` of a variation holds values that are not finite"),
        ((TWO, 1e3 * THREE, VALUES, VALUES), "Millimetres"),
        ((TWO, THREE, VALUES - 5.0, VALUES), "below zero in the layer from 0.034"),
        ((TWO, THREE, VALUES, VALUES - 1600.0), "below zero in the layer from 0.034"),
    ],
)
def test_impossible_variations_are_refused(arguments, message):
    with pytest.raises(InputError, match=message) as caught:
        solve_field(BOWL, DRIVE, LAYERS, r=R, z=Z, settings=COARSE, variation=MediumVariation(*arguments))
    assert "\n" not in str(caught.value)


def test_traced_positions_are_refused():
    with pytest.raises(InputError, match="make it inside"):
        eqx.filter_jit(lambda v: solve_field(BOWL, DRIVE, LAYERS, r=R, z=Z, settings=COARSE, variation=v))(heated())


@pytest.mark.slow
def test_second_order_where_sound_steepens_too():
    """Attenuation that changes does not commute with steepening: half of it acts before and half after."""
    steps = [4e-3 / count for count in (4, 8, 16, 64)]
    z = np.array([58e-3, 66e-3])

    def harmonics(step):
        settings = MarchSettings(n_harmonics=5, n_radial=144, axial_step=step)
        change = heated(attenuation=60.0, sound_speed=0.0)
        solve = eqx.filter_jit(
            lambda drive: (
                solve_field(
                    BOWL, drive, LAYERS, r=np.zeros(1), z=z, settings=settings, diffraction=ALONG_AXIS, variation=change
                ).pressure
            )
        )
        return solve(DRIVE)[:3, 0, 1]

    *found, exact = [harmonics(step) for step in steps]
    assert_order(steps[:-1], [relative(each, exact) for each in found], order=2)
