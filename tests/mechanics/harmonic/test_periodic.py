"""Modulated beams: Fourier series of their force, and the steady motion that they sum up to."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.grid import graded_positions
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.harmonic.motion import HarmonicResult, solve_harmonic
from arfjax.mechanics.harmonic.periodic import PeriodicResult, solve_periodic
from arfjax.mechanics.material.harmonic import solid_field
from arfjax.mechanics.material.viscoelastic import ViscoelasticField, YoungModulus
from arfjax.mechanics.modulation import Modulation, SineIntensity, SinePressure, Square
from arfjax.media import FractionalZener
from arfjax.suomi2016 import TABLE_2_FRACTIONAL_ZENER
from tests.checks import assert_gradient_of_each_leaf
from tests.mechanics.problems import gaussian_force, small_force, small_mesh, uneven_material

FREQUENCY, FOCUS = 70.0, 1e-4


@functools.cache
def motion(
    modulation_type: type[Modulation], share: float, frequency: float, n_harmonics: int | None
) -> PeriodicResult:
    mesh = small_mesh()

    def response(material: ViscoelasticField) -> PeriodicResult:
        return solve_periodic(
            mesh,
            material,
            small_force(mesh),
            frequency=frequency,
            modulation=modulation_type(share),
            n_harmonics=n_harmonics,
            with_offset=True,
            layer=None,
        )

    return jax.jit(response)(uneven_material(mesh))


@pytest.mark.parametrize("modulation", [SinePressure(0.6), SinePressure(), SineIntensity(0.6), Square(0.3), Square()])
def test_coefficients_are_those_of_the_force(modulation):
    n = 2**16
    phase = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    force = np.asarray(modulation.force(phase))
    assert force.max() == pytest.approx(1.0, abs=1e-8) and force.min() >= 0.0
    expected = np.array([(2.0 - (k == 0)) * np.mean(force * np.exp(-1j * k * phase)) for k in range(8)])
    ours = np.asarray(modulation.coefficients(7))
    np.testing.assert_allclose(ours, expected, rtol=0.0, atol=1e-4 if isinstance(modulation, Square) else 1e-12)
    silent = np.setdiff1d(np.arange(1, 8), modulation.orders(7))
    np.testing.assert_allclose(ours[silent], 0.0, atol=1e-15)


def test_a_sine_of_the_pressure_pushes_at_twice_the_frequency_too():
    share = np.asarray(SinePressure(1.0).coefficients(2))
    np.testing.assert_allclose(share, [3.0 / 8.0, 1.0 / 2.0, 1.0 / 8.0], rtol=1e-14)
    np.testing.assert_allclose(SineIntensity(1.0).coefficients(2), [0.5, 0.5, 0.0], rtol=1e-14)
    pressure = np.cos(0.5 * np.linspace(0.0, 7.0, 50))
    np.testing.assert_allclose(SineIntensity(1.0).force(np.linspace(0.0, 7.0, 50)), pressure**2, atol=1e-14)
    assert [m.orders(None) for m in (SinePressure(), SineIntensity())] == [(1, 2), (1,)]
    np.testing.assert_array_equal(Square(1.0).force(np.linspace(-np.pi, np.pi, 9)), 1.0)
    assert Square(0.5).orders(6) == (1, 3, 5) and Square(0.4).orders(None) == tuple(range(1, 16))


def test_slow_modulation_moves_as_the_force_does():
    # One period of a quarter of an hour: tissue in a box follows its static displacement.
    result = motion(SinePressure, 0.6, 1e-3, None)
    time = np.linspace(0.0, 2e3, 41)
    course = np.asarray(result.time_course(FOCUS, time))
    static = float(course[0])
    np.testing.assert_allclose(course, static * SinePressure(0.6).force(2e-3 * np.pi * time), rtol=1e-5)
    np.testing.assert_allclose(result.peak_to_peak(FOCUS), static * (1.0 - (0.4 / 1.6) ** 2), rtol=1e-5)
    assert static > 0.0 and float(jnp.max(jnp.abs(result.offset))) > 0.0


def test_the_motion_is_the_sum_of_its_harmonics():
    mesh, result = small_mesh(), motion(Square, 0.3, FREQUENCY, 3)
    assert result.amplitudes.shape[0] == 3

    @jax.jit
    def one(frequency):
        return solve_harmonic(mesh, uneven_material(mesh), small_force(mesh), frequency=frequency, layer=None)

    expected = [
        2.0 * np.sin(0.3 * np.pi * n) / (np.pi * n) * complex(one(n * FREQUENCY).at_focus(FOCUS)) for n in (1, 2, 3)
    ]
    offset = 0.3 * complex(one(0.0).at_focus(FOCUS)).real
    np.testing.assert_allclose(result.at_focus(FOCUS), expected, rtol=1e-9)
    time = np.linspace(0.0, 1.0 / FREQUENCY, 20_001)  # the highest sample is 1e-7 short of the top
    phases = np.exp(2j * np.pi * FREQUENCY * np.outer(np.arange(1, 4), time))
    course = offset + (np.array(expected) @ phases).real
    np.testing.assert_allclose(result.time_course(FOCUS, time), course, rtol=0.0, atol=1e-9 * np.max(np.abs(course)))
    np.testing.assert_allclose(result.peak_to_peak(FOCUS), np.ptp(course), rtol=1e-6)
    on_axis = np.asarray(result.peak_to_peak_map)[0, 2 * np.argmin(np.abs(mesh.z_edges - 2e-4))]
    np.testing.assert_allclose(on_axis, result.peak_to_peak(2e-4), rtol=1e-10)


def test_what_is_left_out_moves_as_the_last_harmonic_does_against_its_inertia():
    """Motion per force falls with the square of the frequency: 2 |c_n| (3 / n)^2 of that of the third, all added up."""
    result, order = motion(Square, 0.3, FREQUENCY, 3), np.arange(3, 100_000)
    share = 2.0 * np.abs(np.sin(0.3 * np.pi * order)) / (np.pi * order)
    per_force = np.abs(np.asarray(result.amplitudes)[2, ..., 1]) / share[0]
    expected = 2.0 * np.sum(share[1:] * (3.0 / order[1:]) ** 2) * per_force
    # Ours goes to the 24th, beyond which about (3.5 / 24.5)^2 of the sum is left.
    np.testing.assert_allclose(result.left_out_map, expected, rtol=0.03)


def test_empty_harmonics_are_not_solved():
    result = motion(Square, 0.5, FREQUENCY, 3)
    assert float(jnp.max(jnp.abs(result.amplitudes[1]))) == 0.0 and float(jnp.max(jnp.abs(result.amplitudes[2]))) > 0.0
    assert motion(SineIntensity, 1.0, FREQUENCY, None).amplitudes.shape[0] == 1


@functools.cache
def liver_at_50_hz(n_harmonics: int) -> tuple[PeriodicResult, PeriodicResult, HarmonicResult]:
    """Sine of the intensity, square modulation, and one solve: the paper's liver at 35 degC, its force 4 mm long."""
    mesh = Mesh(
        graded_positions(0.0, 5e-3, 0.0, finest=0.25e-3, growth=1.3, coarsest=0.6e-3),
        graded_positions(-9e-3, 9e-3, 0.0, finest=0.8e-3, growth=1.2, coarsest=1.2e-3),
    )
    row = TABLE_2_FRACTIONAL_ZENER[35.0]
    solid = FractionalZener(
        row.relaxed_modulus_pa, 1e3 * row.unrelaxed_modulus_kpa, row.relaxation_time, row.fractional_order
    )
    liver = solid_field(
        solid,
        (len(mesh.gauss_r), len(mesh.gauss_z)),
        density=1060.0,
        bulk_modulus=3e6,
        reading=YoungModulus(),
        poisson_ratio=0.499,
    )
    force = gaussian_force(mesh, 1e5, 0.5945e-3, 3.822e-3)

    @jax.jit
    def all_three(liver):
        sine, square = (
            solve_periodic(mesh, liver, force, frequency=50.0, modulation=modulation, n_harmonics=n_harmonics)
            for modulation in (SineIntensity(), Square())
        )
        return sine, square, solve_harmonic(mesh, liver, force, frequency=50.0)

    return all_three(liver)


def test_harmonic_motion_imaging_of_liver():
    sine, square, alone = liver_at_50_hz(7)
    amplitude = complex(alone.at_focus(0.0))
    # The force is (1 + cos) / 2: peak to peak it moves the tissue by the amplitude of a force that is all harmonic.
    np.testing.assert_allclose(sine.peak_to_peak(0.0), abs(amplitude), rtol=1e-9)
    lag = -np.angle(np.asarray(sine.at_focus(0.0))[0])
    assert 0.0 < lag < np.pi and lag == pytest.approx(-np.angle(amplitude), abs=1e-9)
    # The displacement is highest that much later than the force.
    time = np.linspace(0.0, 0.02, 4001)
    course = np.asarray(sine.time_course(0.0, time))
    assert time[np.argmax(course)] == pytest.approx(lag / (2.0 * np.pi * 50.0), abs=1e-5)
    # No offset unless it is asked for; nothing is left out of a sine, and the bound holds for a square.
    assert float(jnp.max(jnp.abs(sine.offset))) == float(jnp.max(sine.left_out_map)) == 0.0
    np.testing.assert_allclose(np.mean(course[:-1]), 0.0, atol=1e-12 * np.max(course))
    np.testing.assert_allclose(square.at_focus(0.0)[0], 2.0 / np.pi * amplitude, rtol=1e-9)
    assert float(sine.peak_to_peak(0.0)) < float(square.peak_to_peak(0.0)) < 2.0 * abs(amplitude)


@pytest.mark.slow
def test_what_is_left_out_of_a_square_modulation_is_bounded():
    _, full, _ = liver_at_50_hz(31)
    for n in (3, 7, 15):
        _, square, _ = liver_at_50_hz(n)
        change = abs(float(square.peak_to_peak(0.0) - full.peak_to_peak(0.0)))
        assert change < float(square.left_out(0.0)) < 30.0 * change, (n, change, square.left_out(0.0))
        assert n < 15 or change < 0.02 * float(full.peak_to_peak(0.0))


@pytest.mark.slow
def test_gradient():
    mesh = small_mesh()
    start = {
        "material": uneven_material(mesh),
        "force": small_force(mesh),
        "depth": 0.7,
        "frequency": FREQUENCY,
    }

    def observed(x):
        result = solve_periodic(
            mesh,
            x["material"],
            x["force"],
            frequency=x["frequency"],
            modulation=SinePressure(x["depth"]),
            with_offset=True,
            layer=None,
        )
        return 1e6 * (result.peak_to_peak(FOCUS) + 0.1 * result.time_course(FOCUS, jnp.asarray([2e-3]))[0])

    assert_gradient_of_each_leaf(observed, start)


def test_nonsense_is_refused():
    mesh = small_mesh()
    arguments = (mesh, uneven_material(mesh), small_force(mesh))
    with pytest.raises(InputError, match="`depth` must lie in 0 to 1, got 80"):
        SinePressure(80.0)
    with pytest.raises(InputError, match="`duty_cycle` must lie"):
        Square(-0.1)
    with pytest.raises(InputError, match="`frequency` of the modulation must be positive"):
        solve_periodic(*arguments, frequency=0.0, modulation=Square())
    with pytest.raises(InputError, match="`n_harmonics` must be at least 1"):
        solve_periodic(*arguments, frequency=50.0, modulation=Square(), n_harmonics=0)
