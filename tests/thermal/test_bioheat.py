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
from arfjax.thermal import bioheat
from arfjax.thermal.bioheat import (
    Convective,
    FixedTemperature,
    Insulated,
    Phase,
    ThermalField,
    Walls,
    border_rise,
    focal_temperature,
    on_axis,
    solve_bioheat,
    uniform_field,
)
from arfjax.thermal.conduction import cell_conductances, cell_geometry
from arfjax.thermal.splitting import march, split_operator
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


def on_off(duration: float, n_steps: int, heated: float) -> list[Phase]:
    """`duration` in equal steps, the first of them heated."""
    n_heated = round(heated / duration * n_steps)
    return [Phase(heated, n_heated), Phase(duration - heated, n_steps - n_heated, 0.0)]


def rise(field, heat, grid, *, phases, walls=None):
    settings = {"initial_temperature": 37.0, "arterial_temperature": 37.0, "walls": walls}
    history = solve_bioheat(field, heat, grid, phases=phases, **settings)
    return np.asarray(history.temperature) - 37.0


def mode_error(grid: AxisymmetricGrid, n_steps: int, *, insulated: bool, duration: float = 60.0) -> float:
    """Largest error of a mode that is heated for two thirds of the time, relative to its amplitude then."""
    mode = cylinder_mode_insulated if insulated else cylinder_mode
    shape = mode(grid.r[:, None], grid.z[None, :], radius=RADIUS, length=LENGTH)
    rate = cylinder_mode_rate(LIVER, radius=RADIUS, length=LENGTH, insulated=insulated)
    phases = on_off(duration, n_steps, 2.0 * duration / 3.0)
    walls = INSULATED if insulated else Walls()
    got = rise(uniform_field(LIVER, grid), 1e6 * shape, grid, walls=walls, phases=phases)[-1]
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
    reference = rise(field, heat, grid, phases=on_off(60.0, 960, 40.0))[-1]
    steps = [15, 30, 60]
    errors = [np.abs(rise(field, heat, grid, phases=on_off(60.0, n, 40.0))[-1] - reference).max() for n in steps]
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
    phases = on_off(30.0, 300, 10.0)
    history = solve_bioheat(
        uniform_field(medium, grid), heat, grid, initial_temperature=37.0, arterial_temperature=37.0, phases=phases
    )
    focal = focal_temperature(history, grid, 1e-3) - 37.0
    source = {"heat": 2e7, "radius": 1e-3, "half_length": 5e-3, "heating_duration": 10.0}
    for step in (10, 100, 300):
        exact = gaussian_source_rise(r, z, 0.1 * step, medium, **source)
        np.testing.assert_allclose(history.temperature[step] - 37.0, exact, rtol=0.0, atol=1.5e-3 * exact.max())
        at_point = gaussian_source_rise(0.0, 1e-3, 0.1 * step, medium, **source)
        np.testing.assert_allclose(focal[step], at_point, rtol=1.5e-3)


def rates_of(field, grid, walls=None):
    return cell_conductances(field, cell_geometry(grid), Walls() if walls is None else walls)[0]


def test_free_decay_of_a_mode_at_its_rate():
    grid = uniform_grid(32)
    field = uniform_field(LIVER, grid)
    mode = jnp.asarray(cylinder_mode(grid.r[:, None], grid.z[None, :], radius=RADIUS, length=LENGTH, axial_order=2))
    operator = split_operator(field.heat_capacity * grid.volumes, rates_of(field, grid), 0.25)
    state = march(operator, jnp.zeros(grid.shape), mode, 0.25, 40)[-1]
    rate = cylinder_mode_rate(LIVER, radius=RADIUS, length=LENGTH, axial_order=2)
    np.testing.assert_allclose(state, mode * np.exp(-rate * 10.0), atol=1e-3)


@pytest.mark.parametrize("shape", [(12, 16), (16, 12), (1, 9), (9, 1)])
def test_an_insulated_box_keeps_all_heat(shape):
    grid = box(n_r=shape[0], n_z=shape[1])
    field = eqx.tree_at(lambda f: f.perfusion_conductance, layered_field(grid), jnp.zeros(grid.shape))
    heat = np.random.default_rng(1).uniform(0.0, 1e7, grid.shape)
    got = rise(field, heat, grid, phases=on_off(20.0, 40, 12.5), walls=INSULATED)
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
        phases=[Phase(200.0, 200)],
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
    steady = rise(field, np.zeros(grid.shape), grid, phases=[Phase(6e5, 60)], walls=walls)[-1]
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
    steady = rise(field, heat, grid, phases=[Phase(6e5, 60)], walls=walls)[-1][:, 0]
    strength = 1e6 * (RADIUS / 4.0) ** 2 / 2.0
    inner = np.log(0.5 * RADIUS / np.minimum(grid.r, 0.5 * RADIUS)) / 0.3
    exact = strength * (inner + np.log(RADIUS / np.maximum(grid.r, 0.5 * RADIUS)) / 1.2)
    outside = grid.r > RADIUS / 4.0
    np.testing.assert_allclose(steady[outside], exact[outside], atol=5e-4 * exact[outside].max())


def test_smooth_heat_warms_every_cell_at_every_practical_step():
    grid = box()
    heat = 5e6 * np.exp(-((grid.r[:, None] / 2e-3) ** 2) - ((grid.z[None, :] - 1e-2) / 4e-3) ** 2)
    got = rise(uniform_field(LIVER, grid), heat, grid, phases=[Phase(60.0, 20)])
    assert got.min() >= 0.0
    assert np.all(np.diff(got, axis=0) >= 0.0)


def test_temperature_is_that_of_blood_and_walls_when_nothing_happens():
    grid = box()
    walls = Walls(FixedTemperature(0.0), FixedTemperature(0.0), FixedTemperature(0.0))
    got = rise(layered_field(grid), np.zeros(grid.shape), grid, phases=[Phase(3.0, 3)], walls=walls)
    assert np.all(got == 0.0)


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
        phases=[Phase(1.0, 1)],
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
    double = rise(uniform_field(LIVER, grid), heat, grid, phases=[Phase(60.0, 120)])
    with jax.enable_x64(False):
        field = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), uniform_field(LIVER, grid))
        single = rise(field, jnp.asarray(heat, jnp.float32), grid, phases=[Phase(60.0, 120)])
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, atol=1e-5 * double.max() + 4e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, 4), "`duration` > 0"),
        ((np.nan, 4), "`duration` > 0"),
        ((1.0, 0), "`n_steps` >= 1"),
        ((1.0, 4, -1.0), "`power`"),
    ],
)
def test_senseless_phases_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Phase(*arguments)


def test_a_scalar_of_numpy_is_a_number():
    """Which the annotations that are checked in tests do not allow, but others may pass."""
    assert bioheat._known(np.float32(-1.0), 1.0) == bioheat._known(np.int64(-1), 1.0) == -1.0


def test_other_numbers_are_no_other_program(monkeypatch):
    """Durations, powers and walls that are Python numbers; the results are those of arrays."""
    traced = []

    def counted(*arguments):
        traced.append(arguments)
        return split_operator(*arguments)

    monkeypatch.setattr(bioheat, "split_operator", counted)
    grid = box(n_r=5, n_z=7)  # which no other test has had compiled

    def warmed(duration, power, wall):
        walls = Walls(outer=FixedTemperature(wall), far=Convective(50.0, wall))
        heat = np.full(grid.shape, 1e6)
        return rise(uniform_field(LIVER, grid), heat, grid, phases=[Phase(duration, 4, power)], walls=walls)

    given = (2.0, 1.0, 0.5), (2.5, 0.5, 1.0)
    found = [warmed(*numbers) for numbers in given]
    assert len(traced) == 1
    for got, numbers in zip(found, given, strict=True):
        np.testing.assert_allclose(got, warmed(*map(jnp.asarray, numbers)), rtol=1e-14)


def test_senseless_shapes_and_positions_are_refused():
    grid, other = box(), box(n_r=5)
    settings = {"phases": [Phase(2.0, 4)]}
    with pytest.raises(InputError, match="`heat` has shape"):
        rise(uniform_field(LIVER, grid), np.zeros(other.shape), grid, **settings)
    with pytest.raises(InputError, match="`conductivity` has shape"):
        rise(uniform_field(LIVER, other), np.zeros(grid.shape), grid, **settings)
    row = eqx.tree_at(lambda field: field.perfusion_conductance, uniform_field(LIVER, grid), np.zeros((1, 1)))
    with pytest.raises(InputError, match="`perfusion_conductance` has shape"):
        rise(row, np.zeros(grid.shape), grid, **settings)
    with pytest.raises(InputError, match="perfect contact is `FixedTemperature`"):
        Convective(np.inf)
    history = solve_bioheat(
        uniform_field(LIVER, grid),
        np.zeros(grid.shape),
        grid,
        initial_temperature=37.0,
        arterial_temperature=37.0,
        **settings,
    )
    with pytest.raises(InputError, match="`phases` is empty"):
        rise(uniform_field(LIVER, grid), np.zeros(grid.shape), grid, phases=[])
    with pytest.raises(InputError, match="outside the grid"):
        focal_temperature(history, grid, 30.0)
    with pytest.raises(InputError, match="outside the grid"):
        focal_temperature(history, grid, jnp.asarray(30.0))
    with pytest.raises(Exception, match="outside the grid"):
        jax.jit(lambda z: focal_temperature(history, grid, z))(30.0)


def test_the_budget_closes_with_every_kind_of_wall():
    """Delivered = stored + to blood + through walls, to rounding: the losses counted with the method's own weights."""
    grid = box()
    field = layered_field(grid)
    walls = Walls(Convective(800.0, -2.0), FixedTemperature(3.0), Convective(0.0))
    heat = np.random.default_rng(5).uniform(0.0, 1e7, grid.shape)
    conductances, inflow = cell_conductances(field, cell_geometry(grid), walls)
    capacity = field.heat_capacity * grid.volumes
    operator = split_operator(capacity, conductances, 0.7)
    power = jnp.asarray(heat * grid.volumes) + inflow
    rises = jnp.concatenate([jnp.zeros((1, *grid.shape)), march(operator, power, jnp.zeros(grid.shape), 0.7, 5)])
    for before, after in zip(rises[:-1], rises[1:], strict=True):
        first = operator.solve(power - conductances.leaving(before))
        second = operator.solve(power - conductances.leaving(before + 0.7 * first) - 2.0 * capacity * first)
        during = before + 0.5 * operator.weight * (first + second) + 0.35 * first
        # The outer wall meets the rates as they are before the second factor has acted.
        split = operator.weight**2 * conductances.leaving_along_z(first + second) / capacity
        stored = jnp.sum(capacity * (after - before))
        lost = 0.7 * jnp.sum(conductances.loss * during)
        lost = lost + 0.7 * jnp.sum(conductances.outer * (during + 0.5 * split)[-1])
        np.testing.assert_allclose(stored + lost, 0.7 * jnp.sum(power), rtol=1e-12)


@pytest.mark.parametrize("coefficient", [50.0, 800.0, 1e9])
def test_a_convective_wall_passes_the_exact_steady_flux(coefficient):
    """A slab between a wall at 10 K and a stirred bath: half a boundary layer 1 / h in series with L / k."""
    grid = box(n_r=3, n_z=30)
    field = uniform_field(ThermalMedium(0.5, 4e6, 0.0), grid)
    walls = Walls(Insulated(), FixedTemperature(10.0), Convective(coefficient, 1.0))
    steady = rise(field, np.zeros(grid.shape), grid, phases=[Phase(6e5, 60)], walls=walls)[-1]
    flux = 9.0 / (LENGTH / 0.5 + 1.0 / coefficient)
    np.testing.assert_allclose(steady, np.broadcast_to((10.0 - flux * grid.z / 0.5)[None, :], grid.shape), rtol=1e-9)


def test_a_wall_without_transfer_is_insulated():
    grid = box()
    heat = np.random.default_rng(6).uniform(0.0, 1e7, grid.shape)
    film = Walls(Convective(0.0), Convective(0.0), Convective(0.0))
    got = rise(layered_field(grid), heat, grid, phases=[Phase(5.0, 10)], walls=film)
    np.testing.assert_array_equal(got, rise(layered_field(grid), heat, grid, phases=[Phase(5.0, 10)], walls=INSULATED))


def test_metabolic_heat_warms_to_what_blood_takes_away():
    grid = box()
    medium = ThermalMedium(0.5, 4e6, 4e5, metabolic_heat=1e4)
    got = rise(uniform_field(medium, grid), np.zeros(grid.shape), grid, phases=[Phase(50.0, 100)], walls=INSULATED)
    exact = 1e4 / 4e5 * -np.expm1(-0.1 * np.linspace(0.0, 50.0, 101))
    np.testing.assert_allclose(got, np.broadcast_to(exact[:, None, None], got.shape), atol=2e-4 * exact[-1])


@pytest.mark.parametrize("time_step", [1.0, 1e2, 1e4, 1e6])
def test_no_step_is_too_long(time_step):
    """Rough temperature in rough tissue never gains heat content squared, up to a million seconds in one step."""
    grid = box()
    field = layered_field(grid)
    capacity = field.heat_capacity * grid.volumes
    operator = split_operator(capacity, rates_of(field, grid), time_step)
    rough = jnp.asarray(np.random.default_rng(7).normal(size=grid.shape))
    rises = march(operator, jnp.zeros(grid.shape), rough, time_step, 200)
    content = jnp.einsum("rz,trz->t", capacity, rises**2) / jnp.sum(capacity * rough**2)
    assert float(content.max()) < 1.0 and float(content[-1]) < float(content[0])


@pytest.mark.parametrize("cell", [(2, 1), (0, 0), (1, 3)])
def test_rise_of_the_border_is_the_largest_beside_a_wall(cell):
    """Beyond the last radius, before the first and behind the last position; the axis is no wall."""
    temperature = np.full((3, 3, 4), 37.0)
    temperature[1:, :2, 1:3] += 40.0
    assert border_rise(temperature) == 0.0
    temperature[1, *cell] -= 2.0
    assert border_rise(temperature) == pytest.approx(2.0)
