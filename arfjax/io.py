"""Fields and results as labelled data sets with units, and their files (NetCDF)."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import (
    force_density_of_intensity,
    heat_deposition,
    intensity,
    radiation_force_density,
)
from arfjax.acoustics.power import power_budget
from arfjax.acoustics.waveform import peak_pressures, readout, waveform
from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid
from arfjax.laws import SMALLEST_DAMAGE
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.shear_wave import WatchedPush
from arfjax.protocols.sonication import SonicationResult
from arfjax.protocols.stepwise import Heating, StepwiseProtocol, StepwiseResult
from arfjax.protocols.transient import TransientResult
from arfjax.protocols.vibration import Vibration
from arfjax.thermal.bioheat import TemperatureHistory, focal_temperature, on_axis
from arfjax.thermal.lesion import LesionSize

MAPPED_HARMONICS = 5
"""How many harmonics data sets hold as maps; of the others the axis and the focal plane are there."""

_FEWEST_INSTANTS = 128
_INSTANTS_PER_HARMONIC = 8

_SAME_TEMPERATURE_K = 1e-6

VARIABLES = {
    "pressure_amplitude": ("Pa", "peak amplitude of the pressure of each harmonic"),
    "pressure_phase": ("rad", "phase of the pressure of each harmonic, that of exp(+i omega t)"),
    "pressure_amplitude_on_axis": ("Pa", "peak amplitude of the fundamental on the axis"),
    "pressure_amplitude_focal_plane": ("Pa", "peak amplitude of the fundamental in the plane of the geometric focus"),
    "harmonic_amplitude_on_axis": ("Pa", "peak amplitude of all harmonics on the axis"),
    "harmonic_phase_on_axis": ("rad", "phase of all harmonics on the axis"),
    "harmonic_amplitude_focal_plane": ("Pa", "peak amplitude of all harmonics in the plane of the geometric focus"),
    "harmonic_phase_focal_plane": ("rad", "phase of all harmonics in the plane of the geometric focus"),
    "peak_positive_pressure": ("Pa", "highest pressure in a period"),
    "peak_negative_pressure": ("Pa", "lowest pressure in a period, below zero"),
    "focal_waveform": ("Pa", "pressure at the geometric focus over a period"),
    "peak_waveform": ("Pa", "pressure over a period where its peak is highest"),
    "focal_spectrum": ("Pa", "peak amplitude of all harmonics at the geometric focus"),
    "peak_spectrum": ("Pa", "peak amplitude of all harmonics where the peak positive pressure is highest"),
    "entering_power": ("W", "acoustic power behind the layer's front, or the start plane"),
    "leaving_power": ("W", "acoustic power in front of the layer's back, or the last position"),
    "reflected_power": ("W", "acoustic power that does not get past the layer's front"),
    "lost_power": ("W", "acoustic power absorbed, scattered or sent out sideways in the layer"),
    "intensity": ("W m-2", "time-averaged intensity, all harmonics"),
    "heat_deposition": ("W m-3", "absorbed power density, all harmonics"),
    "radiation_force_density": ("N m-3", "radiation force density along the axis, all harmonics"),
    "radiation_force_density_of_intensity": (
        "N m-3",
        "2 alpha I / c with the attenuation of the fundamental",
    ),
    "focal_temperature": ("degC", "temperature at the geometric focus"),
    "temperature": ("degC", "tissue temperature, at the end of the sonication where there is no time"),
    "thermal_dose": ("min", "cumulative equivalent minutes at 43 degC, at the end where there is no time"),
    "arrhenius_damage": ("1", "Arrhenius damage of liver; 1 leaves exp(-1) of the tissue as it was"),
    "thermocouple_temperature": ("degC", "what a thermocouple at the geometric focus would show"),
    "peak_temperature": ("degC", "highest tissue temperature anywhere"),
    "focal_dose": ("min", "cumulative equivalent minutes at 43 degC at the geometric focus"),
    "lesion_volume": ("m3", "volume of the lesion"),
    "field_updates": ("1", "how often the sound field had been computed again"),
    "focal_displacement": ("m", "displacement at the geometric focus since the start of the push"),
    "displacement_map": ("m", "displacement along the push"),
    "radial_strain": ("1", "strain rr"),
    "axial_strain": ("1", "strain zz"),
    "hoop_strain": ("1", "strain tt, around the axis"),
    "shear_strain": ("1", "engineering shear strain rz"),
    "shear_wave_arrival": ("s", "time since the start of the push at which displacement in the focal plane is largest"),
    "peak_to_peak_displacement": ("m", "peak-to-peak displacement along the beam, over a period of the modulation"),
    "vibration_amplitude": ("m", "amplitude of each harmonic of the displacement at the geometric focus"),
    "vibration_phase": ("rad", "phase of each against the middle of the strongest force, that of exp(+i omega t)"),
    "focal_vibration": ("m", "displacement at the geometric focus, from its mean over the period"),
    "relative_force": ("1", "radiation force over the largest in the period"),
    "probed_displacement": ("m", "displacement at the geometric focus that the probe makes"),
    "tracked_displacement": ("m", "the same as the tracker measures it"),
    "tracked_displacement_percent": ("percent", "the same over that when the thermocouple shows the reference"),
    "probed_displacement_map": ("m", "displacement along the beam that the probe makes"),
    "probed_anew": ("1", "1 where the displacement was computed, 0 where it is interpolated in time"),
    "displacement": ("m", "displacement at the geometric focus at the end of the push"),
    "displacement_percent": ("percent", "displacement normalised to the reference temperature"),
    "sonication_time": ("s", "time at which the sonication reaches the step's temperature"),
    "lesion_length": ("m", "length of the lesion along the axis"),
    "lesion_diameter": ("m", "diameter of the lesion across the axis"),
}
"""Standard names of the variables of fields and runs: unit and long name."""

COORDINATES = {
    "r": ("m", "radial distance from the axis"),
    "z": ("m", "axial distance from the bowl's apex"),
    "harmonic": ("1", "number of the harmonic"),
    "carried_harmonic": ("1", "number of the harmonic, all that were carried"),
    "period_time": ("s", "time since the start of the period"),
    "layer": ("1", "number of the layer from the source outwards"),
    "heat_r": ("m", "radial distance of the heat grid's cells"),
    "heat_z": ("m", "axial distance of the heat grid's cells"),
    "heating_time": ("s", "time since the start of the sonication"),
    "push_time": ("s", "time since the start of the push"),
    "course_time": ("s", "time since the start of the push, of the course at the focus"),
    "vibration_harmonic": ("1", "number of the harmonic of the modulation"),
    "modulation_time": ("s", "time since the middle of the strongest force"),
    "probe_r": ("m", "radial distance of the nodes at which the probe's displacement is given"),
    "probe_z": ("m", "axial distance from the bowl's apex of those nodes"),
    "step_temperature": ("degC", "temperature of liver and focus in each step"),
}
"""Standard names of the coordinates: unit and long name."""


def labelled(
    variables: dict[str, tuple[tuple[str, ...], np.ndarray]], coordinates: dict[str, np.ndarray]
) -> xr.Dataset:
    """A data set of standard variables, each with its unit and long name.

    Args:
        variables: Dimensions and values by standard name.
        coordinates: Positions by standard name.

    Raises:
        KeyError: if a name is not a standard one.
    """
    dataset = xr.Dataset(
        {name: (dimensions, np.asarray(values)) for name, (dimensions, values) in variables.items()},
        {name: np.asarray(values) for name, values in coordinates.items()},
    )
    for name in dataset.variables:
        unit, long_name = (COORDINATES | VARIABLES)[str(name)]
        dataset[name].attrs = {"units": unit, "long_name": long_name}
    return dataset


def field_dataset(field: HarmonicField, focus: float) -> xr.Dataset:
    """Pressure, intensity, heat deposition and radiation force of a field, with profiles through the focus [m].

    The field must hold the axis as its first radius. Of many harmonics the first `MAPPED_HARMONICS` are there as maps.
    """
    r, z = np.asarray(field.r), np.asarray(field.z)
    amplitude = np.abs(np.asarray(field.pressure[:MAPPED_HARMONICS]))
    variables = {
        "pressure_amplitude": (("harmonic", "r", "z"), amplitude),
        "pressure_amplitude_on_axis": (("z",), amplitude[0, 0]),
        "pressure_amplitude_focal_plane": (("r",), amplitude[0, :, np.argmin(np.abs(z - focus))]),
        "intensity": (("r", "z"), np.asarray(intensity(field)).sum(axis=0)),
        "heat_deposition": (("r", "z"), np.asarray(heat_deposition(field))),
        "radiation_force_density": (("r", "z"), np.asarray(radiation_force_density(field))),
    }
    if field.pressure.shape[0] > 1:
        peaks = jax.jit(peak_pressures)(field)
        for name, values in zip(("peak_positive_pressure", "peak_negative_pressure"), peaks, strict=True):
            variables[name] = (("r", "z"), np.asarray(values))
    return labelled(variables, {"r": r, "z": z, "harmonic": np.arange(1, len(amplitude) + 1)})


def full_field_dataset(field: HarmonicField, focus: float, *, tolerance: float) -> xr.Dataset:
    """All that a field can tell: `field_dataset`, phases, all harmonics through the focus [m], waveforms, powers.

    What it was asked to be exact to, and whether it is, is in the attributes.
    """
    dataset = field_dataset(field, focus)
    amplitude, phase = np.abs(field.pressure), np.angle(field.pressure)
    plane = int(np.argmin(np.abs(np.asarray(field.z) - focus)))
    if field.pressure.shape[0] == 1:
        peaks = {"peak_positive_pressure": amplitude[0], "peak_negative_pressure": -amplitude[0]}
    else:
        peaks = {name: dataset[name].to_numpy() for name in ("peak_positive_pressure", "peak_negative_pressure")}
    highest = np.unravel_index(np.argmax(peaks["peak_positive_pressure"]), amplitude.shape[1:])
    budget, by_layer, by_harmonic = power_budget(field), ("layer",), ("carried_harmonic",)
    n_instants = max(_FEWEST_INSTANTS, _INSTANTS_PER_HARMONIC * len(amplitude))
    focal, peak = (
        np.asarray(waveform(readout(field.pressure[:, *place]), n_instants)) for place in ((0, plane), highest)
    )
    variables = {
        "pressure_phase": (("harmonic", "r", "z"), phase[:MAPPED_HARMONICS]),
        "harmonic_amplitude_on_axis": ((*by_harmonic, "z"), amplitude[:, 0]),
        "harmonic_phase_on_axis": ((*by_harmonic, "z"), phase[:, 0]),
        "harmonic_amplitude_focal_plane": ((*by_harmonic, "r"), amplitude[:, :, plane]),
        "harmonic_phase_focal_plane": ((*by_harmonic, "r"), phase[:, :, plane]),
        **{name: (("r", "z"), values) for name, values in peaks.items()},
        "focal_waveform": (("period_time",), focal),
        "peak_waveform": (("period_time",), peak),
        "focal_spectrum": (by_harmonic, amplitude[:, 0, plane]),
        "peak_spectrum": (by_harmonic, amplitude[:, *highest]),
        "radiation_force_density_of_intensity": (("r", "z"), np.asarray(force_density_of_intensity(field))),
        "entering_power": (by_layer, budget.entering),
        "leaving_power": (by_layer, budget.leaving),
        "reflected_power": (by_layer, budget.reflected),
        "lost_power": (by_layer, budget.lost),
    }
    coordinates = {
        **{str(name): values.to_numpy() for name, values in dataset.coords.items()},
        "carried_harmonic": np.arange(1, len(amplitude) + 1),
        "period_time": np.arange(n_instants) / (n_instants * float(field.frequency[0])),
        "layer": np.arange(1, len(field.layer_power) + 1),
    }
    dataset = dataset.merge(labelled(variables, coordinates), compat="equals", join="exact")
    dataset.attrs |= _field_attributes(field, dataset, highest, tolerance)
    return dataset


def _field_attributes(
    field: HarmonicField, dataset: xr.Dataset, highest: tuple[np.intp, ...], tolerance: float
) -> dict[str, str | float | int]:
    """Peaks, the two formulas of force, and how far the numbers can be trusted."""
    force = dataset["radiation_force_density"].to_numpy()
    strongest = np.unravel_index(np.argmax(force), force.shape)
    simple = dataset["radiation_force_density_of_intensity"].to_numpy()[strongest]
    convergence, shortcoming = field.convergence, field.convergence.shortcoming(tolerance)
    return {
        "fundamental_hz": float(field.frequency[0]),
        "n_harmonics": len(field.frequency),
        "peak_positive_pressure_pa": float(dataset["peak_positive_pressure"].max()),
        "peak_positive_pressure_r_m": float(field.r[highest[0]]),
        "peak_positive_pressure_z_m": float(field.z[highest[1]]),
        "peak_negative_pressure_pa": float(dataset["peak_negative_pressure"].min()),
        "spatial_peak_temporal_average_intensity_w_m2": float(dataset["intensity"].max()),
        "peak_heat_deposition_w_m3": float(dataset["heat_deposition"].max()),
        "radiation_force_of_intensity_relative_difference": float(simple / force[strongest] - 1.0),
        "tolerance": tolerance,
        "tolerance_statement": f"not reached: {shortcoming}" if shortcoming else "reached",
        **{f"convergence_{name}": float(getattr(convergence, name)) for name in convergence.__dataclass_fields__},
    }


def heating_dataset(heating: Heating, grid: AxisymmetricGrid) -> xr.Dataset:
    """Course of the sonication at the focus, temperature and dose at its end."""
    variables = {
        "focal_temperature": (("heating_time",), np.asarray(heating.focal_temperature)),
        "temperature": (("heat_r", "heat_z"), np.asarray(heating.temperature[-1])),
        "thermal_dose": (("heat_r", "heat_z"), np.asarray(heating.dose[-1])),
    }
    dataset = labelled(variables, {"heating_time": np.asarray(heating.time), "heat_r": grid.r, "heat_z": grid.z})
    dataset.attrs["heating_acoustic_power_w"] = float(heating.acoustic_power)
    return dataset


def sonication_dataset(
    result: SonicationResult, grid: AxisymmetricGrid, focus: float, thermocouple: Float[Array, " time"]
) -> xr.Dataset:
    """Course of a sonication with feedback: maps at every output time, curves at the focus [m], the lesion's growth."""
    by_time, maps = ("heating_time",), ("heating_time", "heat_r", "heat_z")
    dose = TemperatureHistory(result.time, jnp.log(jnp.maximum(result.dose, SMALLEST_DAMAGE)))
    on_axis_highest = jnp.max(on_axis(result.temperature, grid), axis=1)
    variables = {
        "focal_temperature": (by_time, result.focal_temperature),
        "thermocouple_temperature": (by_time, thermocouple),
        "peak_temperature": (by_time, jnp.maximum(jnp.max(result.temperature, axis=(1, 2)), on_axis_highest)),
        "focal_dose": (by_time, jnp.exp(focal_temperature(dose, grid, focus))),
        "temperature": (maps, result.temperature),
        "thermal_dose": (maps, result.dose),
        "arrhenius_damage": (maps, result.damage),
        "lesion_length": (by_time, result.lesion.length),
        "lesion_diameter": (by_time, result.lesion.diameter),
        "lesion_volume": (by_time, result.lesion.volume),
        "field_updates": (by_time, jnp.concatenate([jnp.zeros(1), result.field_updates])),
    }
    arrays = {name: (dimensions, np.asarray(values)) for name, (dimensions, values) in variables.items()}
    return labelled(arrays, {"heating_time": np.asarray(result.time), "heat_r": grid.r, "heat_z": grid.z})


def transient_dataset(
    result: TransientResult, settings: Discretisation, mesh: Mesh, reference_temperature: float
) -> xr.Dataset:
    """A watched sonication: its course, and displacement at every output time, normalised to a temperature [degC].

    Args:
        result: The watched sonication.
        settings: Its grids.
        mesh: Of its probe.
        reference_temperature: That the thermocouple shows when displacement counts as 100 percent [degC].
    """
    data = sonication_dataset(result.sonication, settings.heat_grid, settings.focus, result.thermocouple_temperature)
    by_time = ("heating_time",)
    variables = {
        "probed_displacement": (by_time, result.displacement),
        "tracked_displacement": (by_time, result.tracked),
        "tracked_displacement_percent": (by_time, 100.0 * result.normalised(reference_temperature)),
        "probed_anew": (by_time, np.asarray(result.computed, dtype=float)),
        "probed_displacement_map": ((*by_time, "probe_r", "probe_z"), result.displacement_map),
    }
    arrays = {name: (dimensions, np.asarray(values)) for name, (dimensions, values) in variables.items()}
    probed = labelled(arrays, {"heating_time": np.asarray(result.time), "probe_r": mesh.node_r, "probe_z": mesh.node_z})
    probed.attrs["reference_temperature_degc"] = reference_temperature
    return data.merge(probed, combine_attrs="override").assign_attrs(data.attrs | probed.attrs)


def stepwise_dataset(result: StepwiseResult, protocol: StepwiseProtocol, reference_temperature: float) -> xr.Dataset:
    """Displacement and lesion of every step, in percent of that at one of them, at a reference temperature [degC].

    Raises:
        InputError: if none of the steps is at that temperature.
    """
    temperature = np.asarray(result.temperature)
    displacement = np.asarray(result.displacement)
    nearest = int(np.argmin(np.abs(temperature - reference_temperature)))
    if abs(temperature[nearest] - reference_temperature) > _SAME_TEMPERATURE_K:
        raise InputError(
            f"`reference_temperature` {reference_temperature:g} degC is that of no step; the nearest is at "
            f"{temperature[nearest]:g} degC. Take that, or a step more."
        )
    reference = displacement[nearest]
    history = np.asarray(result.displacement_history)
    variables = {
        "focal_displacement": (("step_temperature", "push_time"), history),
        "displacement": (("step_temperature",), displacement),
        "displacement_percent": (("step_temperature",), 100.0 * displacement / reference),
        "sonication_time": (("step_temperature",), np.asarray(result.time)),
        "lesion_length": (("step_temperature",), np.asarray(result.lesion_length)),
        "lesion_diameter": (("step_temperature",), np.asarray(result.lesion_diameter)),
    }
    push_time = np.linspace(0.0, protocol.push_duration, history.shape[1])
    dataset = labelled(variables, {"step_temperature": temperature, "push_time": push_time})
    dataset.attrs["reference_temperature_degc"] = reference_temperature
    return dataset


def push_dataset(result: WatchedPush, temperature: float) -> xr.Dataset:
    """Maps of displacement and strain, the course at the focus, and when the wave arrives in the focal plane."""
    variables = {
        "displacement_map": (("push_time", "r", "z"), np.asarray(result.displacement)),
        "focal_displacement": (("course_time",), np.asarray(result.focal_displacement)),
        "shear_wave_arrival": (("r",), np.asarray(result.arrival)),
    }
    for i, name in enumerate(("radial_strain", "axial_strain", "hoop_strain", "shear_strain")):
        variables[name] = ("push_time", "r", "z"), np.asarray(result.strain[..., i])
    coordinates = {"push_time": result.time, "course_time": result.focal_time, "r": result.r, "z": result.z}
    dataset = labelled(variables, {name: np.asarray(values) for name, values in coordinates.items()})
    dataset.attrs |= {
        "temperature_degc": temperature,
        "shear_wave_speed_m_s": float(result.speed),
        **_lesion_attributes(result.lesion),
    }
    return dataset


def vibration_dataset(result: Vibration, temperature: float, *, frequency: float, layer_error: float) -> xr.Dataset:
    """Map of peak-to-peak displacement, harmonics and course of a period at the focus, and how far they are exact."""
    amplitude = np.asarray(result.focal_amplitude)
    variables = {
        "peak_to_peak_displacement": (("r", "z"), np.asarray(result.peak_to_peak_map)),
        "vibration_amplitude": (("vibration_harmonic",), np.abs(amplitude)),
        "vibration_phase": (("vibration_harmonic",), np.angle(amplitude)),
        "focal_vibration": (("modulation_time",), np.asarray(result.focal_displacement)),
        "relative_force": (("modulation_time",), np.asarray(result.focal_force)),
    }
    coordinates = {
        "r": np.asarray(result.r),
        "z": np.asarray(result.z),
        "vibration_harmonic": np.asarray(result.harmonic),
        "modulation_time": np.asarray(result.time),
    }
    dataset = labelled(variables, coordinates)
    dataset.attrs |= {
        "temperature_degc": temperature,
        "modulation_frequency_hz": frequency,
        "focal_peak_to_peak_m": float(result.peak_to_peak),
        "left_out_harmonics_m": float(result.left_out),
        "absorbing_layer_relative_error": layer_error,
        **_lesion_attributes(result.lesion),
    }
    return dataset


def _lesion_attributes(lesion: LesionSize) -> dict[str, float]:
    return {
        "lesion_length_m": float(lesion.length),
        "lesion_diameter_m": float(lesion.diameter),
        "lesion_centre_m": float(lesion.centre),
    }


def write_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a data set as NetCDF-4, compressed."""
    encoding = {str(name): {"zlib": True, "complevel": 4} for name, values in dataset.items() if values.ndim > 1}
    dataset.to_netcdf(path, engine="h5netcdf", encoding=encoding)
