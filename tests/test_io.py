"""Data sets of fields: names and units, and that what is derived is what the field says."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from arfjax import InputError, StepwiseProtocol, StepwiseResult
from arfjax.acoustics.intensity import force_density_of_intensity, heat_deposition, radiation_force_density
from arfjax.experiment import read_experiment
from arfjax.figures import draw_field, draw_sound
from arfjax.io import (
    COORDINATES,
    MAPPED_HARMONICS,
    VARIABLES,
    field_dataset,
    full_field_dataset,
    push_dataset,
    stepwise_dataset,
    write_netcdf,
)
from arfjax.mechanics.transient.shear_waves import strain_on_grid
from arfjax.protocols.shear_wave import WatchedPush
from arfjax.thermal.lesion import LesionSize
from tests.acoustics.test_waveform import field_of
from tests.test_experiment import EXAMPLE

R, Z, FOCUS = np.linspace(0.0, 8e-3, 33), np.linspace(45e-3, 80e-3, 71), 62.6e-3


def beam(n):
    """A steepened Gaussian beam whose peak lies at z = 60 mm on the axis, in an attenuating medium."""
    order = np.arange(1.0, n + 1.0)
    along, across = np.exp(-(((Z - 60e-3) / 8e-3) ** 2)), np.exp(-np.outer(order, (R / 2e-3) ** 2))
    pressure = (5e6 / order**2.5 * np.exp(0.3j * order))[:, None, None] * across[:, :, None] * along
    return dataclasses.replace(
        field_of(pressure),
        r=R,
        z=Z,
        attenuation=jnp.broadcast_to(4.0 * order[:, None, None] ** 1.1, pressure.shape),
        layer_power=jnp.asarray([[50.0, 48.0], [47.0, 30.0]]),
    )


def watched():
    """A push in which every strain is another: rr = 2 a r, tt = a r, zz = b and rz = c, each growing with time."""
    time, r, z = 1e-3 * np.arange(5.0), 1e-3 * np.arange(4.0), FOCUS + 1e-3 * np.arange(-2.0, 3.0)
    a, b, c = 0.5, -3e-3, 7e-3
    motion = np.stack(np.broadcast_arrays(a * r[:, None] ** 2, b * (z - FOCUS) + c * r[:, None]), axis=-1)
    displacement = jnp.asarray(time[:, None, None, None] / time[-1] * motion)
    return WatchedPush(
        time=jnp.asarray(time),
        r=r,
        z=z,
        displacement=displacement[..., 1],
        strain=strain_on_grid(r, z, displacement),
        focal_time=jnp.linspace(0.0, 4e-3, 9),
        focal_displacement=1e-6 * jnp.sqrt(jnp.arange(9.0)),
        arrival=jnp.asarray([np.nan, 1e-3, 2e-3, 3e-3]),
        speed=jnp.asarray(1.0),
        lesion=LesionSize(*(jnp.asarray(size) for size in (4e-3, 2e-3, 8e-9, FOCUS))),
    )


@pytest.fixture(scope="module")
def nonlinear():
    return beam(12), full_field_dataset(beam(12), FOCUS, tolerance=1e-3)


def test_every_name_has_its_unit(nonlinear):
    linear = full_field_dataset(beam(1), FOCUS, tolerance=1e-3)
    for data in (nonlinear[1], linear, field_dataset(beam(12), FOCUS)):
        for name in (*data.data_vars, *data.coords):
            unit, long_name = (VARIABLES | COORDINATES)[name]
            assert data[name].attrs == {"units": unit, "long_name": long_name}
    assert set(linear.data_vars) == set(nonlinear[1].data_vars)


def test_what_a_full_data_set_holds(nonlinear):
    field, data = nonlinear
    assert data.sizes["harmonic"] == MAPPED_HARMONICS and data.sizes["carried_harmonic"] == 12
    complex_map = data["pressure_amplitude"] * np.exp(1j * data["pressure_phase"])
    np.testing.assert_allclose(complex_map, field.pressure[:MAPPED_HARMONICS], rtol=1e-12)
    plane = int(np.argmin(np.abs(Z - FOCUS)))
    for name, expected in (("on_axis", field.pressure[:, 0]), ("focal_plane", field.pressure[:, :, plane])):
        found = data[f"harmonic_amplitude_{name}"] * np.exp(1j * data[f"harmonic_phase_{name}"])
        np.testing.assert_allclose(found, expected, rtol=1e-12)
    np.testing.assert_allclose(data["focal_spectrum"], np.abs(field.pressure[:, 0, plane]))
    np.testing.assert_allclose(data["focal_waveform"].max(), data["peak_positive_pressure"][0, plane], rtol=1e-3)
    np.testing.assert_allclose(data["peak_waveform"].min(), data["peak_negative_pressure"].min(), rtol=1e-3)
    period = 1.0 / 1.1e6
    assert 0.0 < period - float(data["period_time"][-1]) < period / 100.0
    np.testing.assert_array_equal(data["entering_power"] - data["leaving_power"], data["lost_power"])
    np.testing.assert_allclose(data["heat_deposition"], heat_deposition(field))


def test_what_the_attributes_state(nonlinear):
    field, data = nonlinear
    told = data.attrs
    assert (told["peak_positive_pressure_r_m"], told["peak_positive_pressure_z_m"]) == (0.0, pytest.approx(60e-3))
    assert told["peak_positive_pressure_pa"] > -1.2 * told["peak_negative_pressure_pa"] > 0.0
    simple, full = force_density_of_intensity(field)[0, 30], radiation_force_density(field)[0, 30]
    assert told["radiation_force_of_intensity_relative_difference"] == pytest.approx(float(simple / full - 1.0))
    assert told["radiation_force_of_intensity_relative_difference"] < -0.01
    assert told["tolerance_statement"] == "reached" and told["tolerance"] == 1e-3
    coarse = dataclasses.replace(field.convergence, axial=jnp.asarray(0.02))
    short = full_field_dataset(dataclasses.replace(field, convergence=coarse), FOCUS, tolerance=1e-3).attrs
    assert short["tolerance_statement"].startswith("not reached: the steps are too long (2.0e-02)")
    assert short["convergence_axial"] == 0.02


def test_linear_fields_keep_their_data_set(nonlinear):
    names = {"pressure_amplitude", "pressure_amplitude_on_axis", "pressure_amplitude_focal_plane", "intensity"}
    assert set(field_dataset(beam(1), FOCUS).data_vars) == names | {"heat_deposition", "radiation_force_density"}


def test_linear_sound_goes_as_far_below_zero_as_above():
    data = full_field_dataset(beam(1), FOCUS, tolerance=1e-3)
    np.testing.assert_array_equal(data["peak_positive_pressure"], data["pressure_amplitude"][0])
    np.testing.assert_array_equal(data["peak_negative_pressure"], -data["pressure_amplitude"][0])
    assert data.attrs["peak_negative_pressure_pa"] == -data.attrs["peak_positive_pressure_pa"] < 0.0


def test_strains_of_a_push_have_their_own_names():
    data = push_dataset(watched(), 40.0).isel(push_time=-1)
    r = data["r"].to_numpy()[:, None]
    for name, exact in (("radial", r), ("hoop", 0.5 * r), ("axial", -3e-3), ("shear", 7e-3)):
        np.testing.assert_allclose(data[f"{name}_strain"], np.broadcast_to(exact, (4, 5)), rtol=1e-9, atol=1e-15)
    assert (data.attrs["lesion_length_m"], data.attrs["lesion_diameter_m"]) == (4e-3, 2e-3)


def test_percent_are_of_a_step_that_was_made():
    result = StepwiseResult(
        jnp.asarray([35.0, 45.0, 55.0]), jnp.arange(3.0), jnp.asarray([[0.0, 10e-6], [0.0, 8e-6], [0.0, 6e-6]]),
        jnp.zeros(3), jnp.zeros(3),
    )  # fmt: skip
    percent = stepwise_dataset(result, StepwiseProtocol(), 45.0)["displacement_percent"]
    np.testing.assert_allclose(percent, [125.0, 100.0, 75.0], rtol=1e-12)
    with pytest.raises(InputError, match="48 degC is that of no step; the nearest is at 45 degC"):
        stepwise_dataset(result, StepwiseProtocol(), 48.0)


def test_files_hold_what_was_written(nonlinear, tmp_path):
    write_netcdf(nonlinear[1], tmp_path / "field.nc")
    with xr.open_dataset(tmp_path / "field.nc", engine="h5netcdf") as read:
        xr.testing.assert_identical(read.load(), nonlinear[1])


def test_figures_show_the_field(nonlinear):
    model, data = read_experiment(EXAMPLE).model(), nonlinear[1]
    panels = {axes.get_title(loc="left"): axes for axes in draw_field(data, model).axes}
    lines = {line.get_label(): line for line in panels["on the axis"].get_lines()}
    np.testing.assert_allclose(lines["$p_+$"].get_ydata(), 1e-6 * data["peak_positive_pressure"][0])
    np.testing.assert_allclose(lines["$-p_-$"].get_ydata(), -1e-6 * data["peak_negative_pressure"][0])
    np.testing.assert_allclose(lines["$|p_2|$"].get_ydata(), 1e-6 * data["pressure_amplitude"][1, 0])
    fronts = [line.get_xdata()[0] for line in panels["peak positive pressure"].get_lines()]
    np.testing.assert_allclose(fronts, [20.6, 22.6, 32.6, 42.6])
    panels = {axes.get_title(loc="left"): axes for axes in draw_sound(data, model).axes}
    wave = panels["one period"].get_lines()[0].get_ydata()
    np.testing.assert_allclose(wave.max(), 1e-6 * data["focal_waveform"].max())
    assert len(panels["spectrum"].get_lines()[0].get_xdata()) == 12
    linear = {axes.get_title(loc="left"): axes for axes in draw_field(field_dataset(beam(1), FOCUS), model).axes}
    assert len(linear["pressure amplitude"].get_lines()) == 4 and linear["on the axis"].get_legend() is None
