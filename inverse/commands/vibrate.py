"""`arfjax vibrate`: heated tissue under a modulated beam, as harmonic motion imaging sees it."""

import enum
from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np
import typer
import xarray as xr

import arfjax.figures
from arfjax import (
    Discretisation,
    Experiment,
    InputError,
    Modulation,
    SineIntensity,
    SinePressure,
    Square,
    range_notes,
    read_experiment,
    resolving,
    simulate_heating,
    vibrate,
    vibration_layer_error,
)
from arfjax.experiment.mechanics import Mechanics
from arfjax.io import vibration_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.notes import assumed_notes, grid_notes, heated_border_notes, sound_notes
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_LOWEST, _HIGHEST = 5.0, 1000.0  # Hz
_SHOWN = 5
_LOUD_LAYER = 0.01


class ModulationKind(enum.StrEnum):
    """What goes as a sine or is switched on and off."""

    INTENSITY = "intensity"
    PRESSURE = "pressure"
    SQUARE = "square"


def vibrate_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    temperature_c: Annotated[
        float | None, typer.Option(help="Of the tissue [degC]; without it the last of the protocol's temperatures.")
    ] = None,
    frequency_hz: Annotated[float, typer.Option(help="At which the force repeats [Hz].")] = 50.0,
    modulation: Annotated[
        ModulationKind, typer.Option(help="A sine of the intensity or of the pressure, or on and off.")
    ] = ModulationKind.INTENSITY,
    depth: Annotated[
        float | None, typer.Option(help="Of a sine, from 0 to 1; 1, down to silence, if not given.")
    ] = None,
    duty_cycle: Annotated[
        float | None, typer.Option(help="Of `square`: share of the period in which the beam is on; 0.5 if not given.")
    ] = None,
) -> None:
    """Shake the heated liver by a modulated beam: peak-to-peak displacement, harmonics, a map.

    Tissue, lesion and force are those that the experiment's protocol has when its focus comes to the temperature; the
    file's power is that of the beam at its strongest.

    Writes vibration.nc, a figure (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    assumed = assumed_notes(described, "mechanics", "lesion")
    temperature, course = _checked(described, temperature_c, frequency_hz, modulation, depth, duty_cycle)
    model, protocol = described.model(), described.stepwise()
    with output_directory(out) as folder:
        with progress_bar(4) as step:
            step("discretisation")
            settings = described.discretised(model)
            chosen = resolving(model, temperature, settings, frequency=frequency_hz, modulation=course)
            step("heating")
            heating = compiled(lambda model: simulate_heating(model, protocol, settings))(model)
            given: dict[str, Any] = {"heating": heating, "frequency": frequency_hz, "vibration": chosen}
            step("vibration")
            result = compiled(lambda model, at: vibrate(model, at, protocol, settings, modulation=course, **given))(
                model, jnp.asarray(temperature)
            )
            step("error of the layer")
            error = compiled(lambda model, at: vibration_layer_error(model, at, protocol, settings, **given))(
                model, jnp.asarray(temperature)
            )
            data = vibration_dataset(result, temperature, frequency=frequency_hz, layer_error=float(error))
        data.attrs |= {
            "title": described.title,
            "acoustic_power_w": float(model.drive.acoustic_power),
            "modulation": _words(course),
            "arfjax_version": arfjax.__version__,
        }
        write_netcdf(data, folder / "vibration.nc")
        figures = write_figures(folder, {"vibration": arfjax.figures.draw_vibration(data, model)})
        notes = assumed + range_notes(model, np.asarray([temperature]), np.asarray([float(result.lesion.length)]))
        notes += heated_border_notes(heating, temperature)
        notes += sound_notes(settings, 1.0) + grid_notes(model) + _notes(described, settings, data)
        (folder / "report.md").write_text(_report(data, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="vibrate",
            inputs=inputs,
            settings={
                "temperature_c": temperature,
                "frequency_hz": frequency_hz,
                "modulation": data.attrs["modulation"],
                "largest_element_m": chosen.coarsest,
                "protocol": described.protocol.model_dump(),
            },
            results=_results(data),
        )
    show_table(f"{frequency_hz:g} Hz at {temperature:g} degC", ("quantity", "value"), _rows(data))
    show_lines([*notes, f"written to {out}"])


def _checked(
    described: Experiment,
    temperature: float | None,
    frequency: float,
    kind: ModulationKind,
    depth: float | None,
    duty_cycle: float | None,
) -> tuple[float, Modulation]:
    temperatures = described.protocol.temperatures_c
    temperature = temperatures[-1] if temperature is None else temperature
    if not temperatures[0] <= temperature <= temperatures[-1]:  # what is not a number, too
        raise InputError(
            f"--temperature-c must lie between {temperatures[0]:g} and {temperatures[-1]:g} degC, where the "
            f"experiment's protocol goes, got {temperature:g}."
        )
    if not _LOWEST <= frequency <= _HIGHEST:
        raise InputError(f"--frequency-hz must be {_LOWEST:g} to {_HIGHEST:g} Hz, got {frequency:g}. Give hertz.")
    if kind is ModulationKind.SQUARE:
        if depth is not None:
            raise InputError(f"--depth {depth:g} has no effect on square modulation; give --duty-cycle instead.")
        return temperature, Square(_share("--duty-cycle", 0.5 if duty_cycle is None else duty_cycle, below=1.0))
    if duty_cycle is not None:
        raise InputError(f"--duty-cycle {duty_cycle:g} is only for --modulation square; give --depth instead.")
    share = _share("--depth", 1.0 if depth is None else depth)
    return temperature, SineIntensity(share) if kind is ModulationKind.INTENSITY else SinePressure(share)


def _share(option: str, value: float, *, below: float = np.inf) -> float:
    if not (0.01 <= value <= 1.0 and value < below):
        highest = "below 1" if below == 1.0 else "1"
        raise InputError(f"{option} must be 0.01 to {highest}, got {value:g}; it is a share, not a percentage.")
    return value


def _words(course: Modulation) -> str:
    match course:
        case SineIntensity():
            return f"sine of the intensity, depth {course.depth:g}"
        case SinePressure():
            return f"sine of the pressure, depth {course.depth:g}"
        case Square():
            return f"square, duty cycle {course.duty_cycle:g}"
    raise AssertionError(course)


def _notes(described: Experiment, settings: Discretisation, data: xr.Dataset) -> list[str]:
    notes = ["the mean displacement is left out: it takes the tissue's relaxed modulus many relaxation times to show."]
    if settings.march.n_harmonics > 1 and not data.attrs["modulation"].startswith("square"):
        notes.append("sound is nonlinear: where the beam is weaker, its force is taken in proportion to intensity.")
    mechanics = described.mechanics
    if mechanics.outer_layers_mm is not None or mechanics.walls != Mechanics().walls:
        notes.append("walls and outer layers play no part: tissue goes on without end in an absorbing layer.")
    error = data.attrs["absorbing_layer_relative_error"]
    if error > _LOUD_LAYER:
        notes.append(f"the absorbing layer is too thin for waves this long: its error is {100.0 * error:.1f} %.")
    return notes


def _rows(data: xr.Dataset) -> list[tuple[str, str]]:
    attributes = data.attrs
    amplitude, phase = (data[f"vibration_{name}"].to_numpy() for name in ("amplitude", "phase"))
    frequencies = data["vibration_harmonic"].to_numpy() * attributes["modulation_frequency_hz"]
    tones = [
        (f"amplitude and phase at {frequency:g} Hz", f"{1e6 * height:.3f} um, {angle:.2f} rad")
        for frequency, height, angle in zip(frequencies, amplitude, phase, strict=True)
    ]
    left_out, length = attributes["left_out_harmonics_m"], attributes["lesion_length_m"]
    return [
        ("peak-to-peak displacement at the focus", f"{1e6 * attributes['focal_peak_to_peak_m']:.3f} um"),
        *tones[:_SHOWN],
        ("harmonics left out, if inertia rules them", f"at most {1e6 * left_out:.3f} um" if left_out else "none"),
        ("error of the absorbing layer", f"{100.0 * attributes['absorbing_layer_relative_error']:.1g} %"),
        ("lesion", f"{1e3 * length:.1f} x {1e3 * attributes['lesion_diameter_m']:.1f} mm" if length else "none"),
    ]


def _results(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    return {
        "peak_to_peak_displacement": quantity(data.attrs["focal_peak_to_peak_m"], "m"),
        "harmonics": {"value": data["vibration_harmonic"].to_numpy().tolist(), "unit": "1"},
        "amplitude": {"value": data["vibration_amplitude"].to_numpy().tolist(), "unit": "m"},
        "phase": {"value": data["vibration_phase"].to_numpy().tolist(), "unit": "rad"},
        "left_out_harmonics": quantity(data.attrs["left_out_harmonics_m"], "m"),
        "absorbing_layer_relative_error": quantity(data.attrs["absorbing_layer_relative_error"], "1"),
        "lesion_length": quantity(data.attrs["lesion_length_m"], "m"),
        "lesion_diameter": quantity(data.attrs["lesion_diameter_m"], "m"),
    }


def _report(data: xr.Dataset, figures: list[str], notes: list[str]) -> str:
    attributes = data.attrs
    lines = [
        f"# {attributes['title']}: steady motion at {attributes['modulation_frequency_hz']:g} Hz",
        "",
        f"A beam of {attributes['acoustic_power_w']:g} W of acoustic power at its strongest, modulated "
        f"({attributes['modulation']}), on tissue at {attributes['temperature_degc']:g} degC that goes on without end.",
        "",
        "| quantity | value |",
        "| --- | ---: |",
        *("| " + " | ".join(row) + " |" for row in _rows(data)),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
