"""The bioheat solver against exact solutions, its orders, and what it must conserve."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax.errors import InputError
from arfjax.exact.bioheat import (
    cylinder_mode,
    cylinder_mode_insulated,
    cylinder_mode_rate,
    gaussian_source_rise,
    heated_mode_amplitude,
)
from arfjax.grid import AxisymmetricGrid, graded_positions
from arfjax.media import ThermalMedium
from arfjax.thermal.bioheat import (
    FixedTemperature,
    Insulated,
    ThermalField,
    Walls,
    bioheat_stepper,
    focal_temperature,
    on_axis,
    positive_time_step,
    solve_bioheat,
    uniform_field,
)
from tests.checks import assert_order

LIVER = ThermalMedium(conductivity=0.51, heat_capacity=3.8e6, perfusion_conductance=3.6e4)
RADIUS, LENGTH = 8e-3, 2e-2
INSULATED = Walls(Insulated(), Insulated(), Insulated())


def uniform_grid(n: int, radius: float = RADIUS, length: float = LENGTH) -> AxisymmetricGrid:
    return AxisymmetricGrid(np.linspace(0.0, radius, n + 1), np.linspace(0.0, length, 2 * n + 1))


def stretched_grid(n: int) -> AxisymmetricGrid:
    """Cells four times finer at the axis and in the middle of z than at the walls, by a smooth map."""
    xi, eta = np.linspace(0.0, 1.0, n + 1), np.linspace(-1.0, 1.0, 2 * n + 1)
    return AxisymmetricGrid(RADIUS * (0.4 * xi + 0.6 * xi**2), 0.5 * LENGTH * (1.0 + 0.4 * eta + 0.6 * eta**3))


def box(radius: float = RADIUS, length: float = LENGTH, n_r: int = 12, n_z: int = 16) -> AxisymmetricGrid:
    return AxisymmetricGrid(radius * np.linspace(0.0, 1.0, n_r + 1) ** 1.3, length * np.linspace(0.0, 1.0, n_z + 1))


def layered_field(grid: AxisymmetricGrid, seed: int = 0) -> ThermalField:
    """Every cell another medium: interfaces everywhere."""
    rng = np.random.default_rng(seed)
    return ThermalField(
        conductivity=jnp.asarray(rng.uniform(0.1, 2.0, grid.shape)),
        heat_capacity=jnp.asarray(rng.uniform(1e6, 5e6, grid.shape)),
        perfusion_conductance=jnp.asarray(rng.uniform(0.0, 5e4, grid.shape)),
    )


def rise(field, heat, grid, **settings):
    history = solve_bioheat(field, heat, grid, initial_temperature=37.0, arterial_temperature=37.0, **settings)
    return np.asarray(history.temperature) - 37.0


def mode_error(grid: AxisymmetricGrid, n_steps: int, *, insulated: bool, duration: float = 60.0) -> float:
    """Largest error of a mode that is heated for two thirds of the time, relative to its amplitude then."""
    mode = cylinder_mode_insulated if insulated else cylinder_mode
    shape = mode(grid.r[:, None], grid.z[None, :], radius=RADIUS, length=LENGTH)
    rate = cylinder_mode_rate(LIVER, radius=RADIUS, length=LENGTH, insulated=insulated)
    settings = {"heating_duration": 2.0 * duration / 3.0, "time_step": duration / n_steps, "n_steps": n_steps}
    walls = INSULATED if insulated else Walls()
    got = rise(uniform_field(LIVER, grid), 1e6 * shape, grid, walls=walls, **settings)[-1]
    amplitude = heated_mode_amplitude(duration, rate, LIVER, heat=1e6, heating_duration=2.0 * duration / 3.0)
    return float(np.abs(got - amplitude * shape).max() / amplitude)


@pytest.mark.parametrize("insulated", [False, True])
@pytest.mark.parametrize("make_grid", [uniform_grid, stretched_grid])
def test_second_order_in_space(make_grid, insulated):
    cells = [8, 16, 32] if make_grid is uniform_grid else [12, 24, 48]
    errors = [mode_error(make_grid(n), 60, insulated=insulated) for n in cells]
    assert_order([1.0 / n for n in cells], errors, order=2.0, slack=0.15)
    assert errors[-1] < 3e-3


def test_second_order_in_time():
    grid = uniform_grid(6)
    field = uniform_field(LIVER, grid)
    heat = 5e6 * np.exp(-((grid.r[:, None] / 2e-3) ** 2) - ((grid.z[None, :] - 1e-2) / 4e-3) ** 2)
    settings = {"heating_duration": 40.0}
    reference = rise(field, heat, grid, time_step=60.0 / 960, n_steps=960, **settings)[-1]
    steps = [15, 30, 60]
    errors = [
        np.abs(rise(field, heat, grid, time_step=60.0 / n, n_steps=n, **settings)[-1] - reference).max() for n in steps
    ]
    assert_order([1.0 / n for n in steps], errors, order=2.0, slack=0.15)
    assert errors[-1] < 1e-3 * reference.max()


@pytest.mark.parametrize("perfusion", [0.0, 1e5])
def test_gaussian_source_in_a_wide_box(perfusion):
    """The box is 14 diffusion lengths wide and 7 half lengths long, so that its walls do not show."""
    medium = ThermalMedium(0.51, 3.8e6, perfusion)
    r_faces = graded_positions(0.0, 3e-2, 0.0, finest=6e-5, growth=1.06, coarsest=3e-3)
    z_faces = graded_positions(-3.5e-2, 3.5e-2, 0.0, finest=3e-4, growth=1.08, coarsest=3e-3)
    grid = AxisymmetricGrid(r_faces, z_faces)
    r, z = grid.r[:, None], grid.z[None, :]
    heat = 2e7 * np.exp(-((r / 1e-3) ** 2) - (z / 5e-3) ** 2)
    times = {"time_step": 0.1, "n_steps": 300, "heating_duration": 10.0}
    history = solve_bioheat(
        uniform_field(medium, grid), heat, grid, initial_temperature=37.0, arterial_temperature=37.0, **times
    )
    focal = focal_temperature(history, grid, 1e-3) - 37.0
    source = {"heat": 2e7, "radius": 1e-3, "half_length": 5e-3, "heating_duration": 10.0}
    for step in (10, 100, 300):
        exact = gaussian_source_rise(r, z, 0.1 * step, medium, **source)
        np.testing.assert_allclose(history.temperature[step] - 37.0, exact, rtol=0.0, atol=1.5e-3 * exact.max())
        at_point = gaussian_source_rise(0.0, 1e-3, 0.1 * step, medium, **source)
        np.testing.assert_allclose(focal[step], at_point, rtol=1.5e-3)


def test_free_decay_of_a_mode_at_its_rate():
    grid = uniform_grid(32)
    stepper = bioheat_stepper(
        uniform_field(LIVER, grid), grid, initial_temperature=37.0, arterial_temperature=37.0, time_step=0.25
    )
    mode = jnp.asarray(cylinder_mode(grid.r[:, None], grid.z[None, :], radius=RADIUS, length=LENGTH, axial_order=2))
    advance = eqx.filter_jit(lambda stepper, state: stepper.advance(state, jnp.zeros(grid.shape)))
    state = mode
    for _ in range(40):
        state = advance(stepper, state)
    rate = cylinder_mode_rate(LIVER, radius=RADIUS, length=LENGTH, axial_order=2)
    np.testing.assert_allclose(state, mode * np.exp(-rate * 10.0), atol=1e-3)


@pytest.mark.parametrize("shape", [(12, 16), (16, 12), (1, 9), (9, 1)])
def test_an_insulated_box_keeps_all_heat(shape):
    grid = box(n_r=shape[0], n_z=shape[1])
    field = eqx.tree_at(lambda f: f.perfusion_conductance, layered_field(grid), jnp.zeros(grid.shape))
    heat = np.random.default_rng(1).uniform(0.0, 1e7, grid.shape)
    got = rise(field, heat, grid, time_step=0.5, n_steps=40, heating_duration=12.5, walls=INSULATED)
    stored = np.sum(np.asarray(field.heat_capacity) * grid.volumes * got, axis=(1, 2))
    delivered = np.sum(heat * grid.volumes) * np.minimum(0.5 * np.arange(41), 12.5)
    np.testing.assert_allclose(stored, delivered, rtol=1e-11, atol=1e-11 * delivered[-1])


def test_an_insulated_box_relaxes_to_arterial_temperature():
    """Uniform tissue, no heat: exp(-w t) with the stability function of the method in place of the exponential."""
    grid = box()
    history = solve_bioheat(
        uniform_field(LIVER, grid),
        np.zeros(grid.shape),
        grid,
        initial_temperature=42.0,
        arterial_temperature=37.0,
        time_step=1.0,
        n_steps=200,
        walls=INSULATED,
    )
    exact = 37.0 + 5.0 * np.exp(-3.6e4 / 3.8e6 * np.asarray(history.time))
    np.testing.assert_allclose(
        history.temperature, np.broadcast_to(exact[:, None, None], history.temperature.shape), atol=5e-6
    )


def test_layers_pass_the_same_steady_flux():
    """Three layers in series between two walls: the exact flux of a 1-D wall, in every layer."""
    grid = box(n_r=3, n_z=30)
    conductivity = np.repeat([0.2, 0.6, 1.5], 10)
    field = ThermalField(
        conductivity=jnp.asarray(np.broadcast_to(conductivity[None, :], grid.shape)),
        heat_capacity=jnp.full(grid.shape, 4e6),
        perfusion_conductance=jnp.zeros(grid.shape),
    )
    walls = Walls(Insulated(), FixedTemperature(10.0), FixedTemperature(0.0))
    steady = rise(field, np.zeros(grid.shape), grid, time_step=1e4, n_steps=60, walls=walls)[-1]
    layer = LENGTH / 3.0
    flux = 10.0 / (layer / 0.2 + layer / 0.6 + layer / 1.5)
    resistance = np.concatenate([[0.0], np.cumsum(np.diff(grid.z_faces) / conductivity)])
    exact = 10.0 - flux * 0.5 * (resistance[1:] + resistance[:-1])
    np.testing.assert_allclose(steady, np.broadcast_to(exact[None, :], grid.shape), rtol=1e-9)


def test_layers_in_radius_pass_the_same_steady_power():
    """Heat made in the core leaves through every ring: the drop over each ring is that of ln(r) to second order."""
    grid = AxisymmetricGrid(np.linspace(0.0, RADIUS, 61), np.array([0.0, LENGTH]))
    conductivity = np.repeat([0.3, 1.2], 30)[:, None]
    field = ThermalField(jnp.asarray(conductivity), jnp.full(grid.shape, 4e6), jnp.zeros(grid.shape))
    heat = np.where(grid.r < RADIUS / 4.0, 1e6, 0.0)[:, None]
    walls = Walls(FixedTemperature(), Insulated(), Insulated())
    steady = rise(field, heat, grid, time_step=1e4, n_steps=60, walls=walls)[-1][:, 0]
    strength = 1e6 * (RADIUS / 4.0) ** 2 / 2.0
    inner = np.log(0.5 * RADIUS / np.minimum(grid.r, 0.5 * RADIUS)) / 0.3
    exact = strength * (inner + np.log(RADIUS / np.maximum(grid.r, 0.5 * RADIUS)) / 1.2)
    outside = grid.r > RADIUS / 4.0
    np.testing.assert_allclose(steady[outside], exact[outside], atol=5e-4 * exact[outside].max())


def test_no_heat_however_rough_cools_any_cell_below_the_start():
    grid = box()
    field = layered_field(grid)
    heat = np.zeros(grid.shape)
    heat[3, 5] = 1e8
    step = float(positive_time_step(field, grid))
    got = rise(field, heat, grid, n_steps=60, heating_duration=20 * step, time_step=step)
    assert got.min() >= -1e-13 and got.max() > 1.0


@pytest.mark.parametrize(("multiple", "stays_positive"), [(1.0, True), (10.0, False)])
def test_the_limit_of_positive_steps_is_needed(multiple, stays_positive):
    grid = uniform_grid(8)
    field = uniform_field(LIVER, grid)
    hot = jnp.zeros(grid.shape).at[3, 5].set(1.0)
    step = multiple * positive_time_step(field, grid)

    @jax.jit
    def after_one_step(hot):
        temperatures = {"initial_temperature": 37.0, "arterial_temperature": 37.0}
        return bioheat_stepper(field, grid, time_step=step, **temperatures).advance(hot, jnp.zeros(grid.shape))

    assert (float(jnp.min(after_one_step(hot))) >= -1e-15) == stays_positive


def test_smooth_heat_warms_every_cell_at_every_practical_step():
    grid = box()
    heat = 5e6 * np.exp(-((grid.r[:, None] / 2e-3) ** 2) - ((grid.z[None, :] - 1e-2) / 4e-3) ** 2)
    got = rise(uniform_field(LIVER, grid), heat, grid, n_steps=20, time_step=3.0)
    assert got.min() >= 0.0
    assert np.all(np.diff(got, axis=0) >= 0.0)


def test_temperature_is_that_of_blood_and_walls_when_nothing_happens():
    grid = box()
    walls = Walls(FixedTemperature(0.0), FixedTemperature(0.0), FixedTemperature(0.0))
    got = rise(layered_field(grid), np.zeros(grid.shape), grid, time_step=1.0, n_steps=3, walls=walls)
    assert np.all(got == 0.0)


def test_both_orders_of_the_blocks_give_the_same_temperature():
    """A grid that is wide and short is solved ring by ring, a narrow and long one slice by slice."""
    long = AxisymmetricGrid(np.linspace(0.0, 4e-3, 5), np.linspace(0.0, 8e-3, 9))
    wide = AxisymmetricGrid(np.linspace(0.0, 1e-2, 11), long.z_faces)
    field, outer = layered_field(wide), Walls(Insulated(), FixedTemperature(), FixedTemperature())
    cut = eqx.tree_at(lambda f: f.conductivity, field, field.conductivity.at[4:].set(1e-12))
    heat = np.random.default_rng(2).uniform(0.0, 1e7, wide.shape)
    settings = {"time_step": 1.0, "n_steps": 5, "walls": outer}
    from_wide = rise(cut, heat, wide, **settings)
    from_long = rise(jax.tree.map(lambda leaf: leaf[:4], cut), heat[:4], long, **settings)
    np.testing.assert_allclose(from_wide[:, :4], from_long, rtol=1e-8, atol=1e-10)


def test_axis_and_interpolation_are_exact_for_their_polynomials():
    grid = AxisymmetricGrid(np.array([0.0, 1.0, 2.5, 3.0]), np.array([0.0, 1.0, 1.5, 3.0, 4.0, 6.0, 7.0]))
    r, z = grid.r[:, None], grid.z[None, :]
    values = jnp.asarray(2.0 * r**2 + z**3 - 2.0 * z)
    np.testing.assert_allclose(on_axis(values, grid), grid.z**3 - 2.0 * grid.z, rtol=1e-12)
    history = solve_bioheat(
        uniform_field(LIVER, grid),
        np.zeros(grid.shape),
        grid,
        initial_temperature=0.0,
        arterial_temperature=0.0,
        time_step=1.0,
        n_steps=1,
    )
    history = eqx.tree_at(lambda h: h.temperature, history, jnp.stack([values, 2.0 * values]))
    for at in (0.1, 1.25, 2.0, 3.3, 6.9):
        expected = at**3 - 2.0 * at
        np.testing.assert_allclose(focal_temperature(history, grid, at), [expected, 2.0 * expected], rtol=1e-12)
    slope = jax.jit(jax.grad(lambda at: focal_temperature(history, grid, at)[0]))(jnp.asarray(3.3))
    np.testing.assert_allclose(slope, 3.0 * 3.3**2 - 2.0, rtol=1e-12)


def test_single_precision_agrees():
    grid = box()
    heat = 5e6 * np.exp(-((grid.r[:, None] / 2e-3) ** 2) - ((grid.z[None, :] - 1e-2) / 4e-3) ** 2)
    double = rise(uniform_field(LIVER, grid), heat, grid, time_step=0.5, n_steps=120)
    with jax.enable_x64(False):
        field = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), uniform_field(LIVER, grid))
        single = rise(field, jnp.asarray(heat, jnp.float32), grid, time_step=0.5, n_steps=120)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, atol=1e-5 * double.max() + 4e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_step": 0.0}, "`time_step` > 0"),
        ({"n_steps": 0}, "`n_steps` >= 1"),
        ({"heating_duration": 0.75}, "whole number of steps"),
        ({"heating_duration": -1.0}, "whole number of steps"),
    ],
)
def test_senseless_times_are_refused(change, message):
    grid = box()
    settings = {"time_step": 0.5, "n_steps": 4} | change
    with pytest.raises(InputError, match=message):
        rise(uniform_field(LIVER, grid), np.zeros(grid.shape), grid, **settings)


def test_senseless_shapes_and_positions_are_refused():
    grid, other = box(), box(n_r=5)
    settings = {"time_step": 0.5, "n_steps": 4}
    with pytest.raises(InputError, match="`heat` has shape"):
        rise(uniform_field(LIVER, grid), np.zeros(other.shape), grid, **settings)
    with pytest.raises(InputError, match="`field` has shape"):
        rise(uniform_field(LIVER, other), np.zeros(grid.shape), grid, **settings)
    history = solve_bioheat(
        uniform_field(LIVER, grid),
        np.zeros(grid.shape),
        grid,
        initial_temperature=37.0,
        arterial_temperature=37.0,
        **settings,
    )
    with pytest.raises(InputError, match="outside the grid"):
        focal_temperature(history, grid, 30.0)
    with pytest.raises(Exception, match="outside the grid"):
        focal_temperature(history, grid, jnp.asarray(30.0))
