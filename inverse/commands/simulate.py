"""`arfjax simulate`: run an experiment's protocol and write fields, heating and displacement."""

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
    Heating,
    Model,
    StepwiseResult,
    TemperatureHistory,
    boiling_time,
    layered_field,
    range_notes,
    read_experiment,
    run_stepwise,
    simulate_heating,
)
from arfjax.io import field_dataset, heating_dataset, stepwise_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.notes import assumed_notes, boiling_notes, grid_notes, heated_border_notes, sound_notes
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_FIELD_RADIUS = 20e-3  # m
_FIELD_STEP = 0.25e-3  # m


def simulate(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
) -> None:
    """Simulate an experiment: field, heating, lesion and displacement at every temperature of its protocol.

    Writes simulation.nc, figures (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    assumed = assumed_notes(described, "mechanics", "lesion")
    model = described.model()
    with output_directory(out) as folder:
        with progress_bar(3) as step:
            step("sound field")
            settings = described.discretised(model)
            field = display_field(model, described, settings)
            step("heating")
            protocol = described.stepwise()
            heating = compiled(lambda model: simulate_heating(model, protocol, settings))(model)
            step("pushes")
            result = simulate_steps(model, described, settings, heating)
        data = xr.merge(
            [field, heating_dataset(heating, settings.heat_grid), result_dataset(result, described)],
            combine_attrs="no_conflicts",
        )
        data.attrs |= {
            "title": described.title,
            "acoustic_power_w": float(model.drive.acoustic_power),
            "n_harmonics": settings.march.n_harmonics,
            "arfjax_version": arfjax.__version__,
        }
        write_netcdf(data, folder / "simulation.nc")
        figures = write_figures(
            folder,
            {
                "field": arfjax.figures.draw_field(data, model),
                "heating": arfjax.figures.draw_heating(data, model),
                "displacement": arfjax.figures.draw_displacement(result_dataset(result, described)),
            },
        )
        notes = assumed + range_notes(model, np.asarray(result.temperature), np.asarray(result.lesion_length))
        course = TemperatureHistory(heating.time, heating.temperature)
        notes += boiling_notes(boiling_time(course, settings.heat_grid))
        notes += heated_border_notes(heating, protocol.final_temperature)
        notes += sound_notes(settings, float(heating.acoustic_power / model.drive.acoustic_power))
        notes += grid_notes(model)
        (folder / "report.md").write_text(_report(described, data, heating, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="simulate",
            inputs=inputs,
            settings={"protocol": described.protocol.model_dump()},
            results=_results(data, heating),
        )
    show_table("displacement at the geometric focus", _HEADER, _rows(data))
    show_lines([*notes, f"written to {out}"])


def display_field(model: Model, described: Experiment, settings: Discretisation) -> xr.Dataset:
    """The field at the protocol's start temperature on a regular grid for the eye, through all layers."""
    protocol = described.stepwise()
    back = model.liver_depth + model.liver_thickness
    r = np.linspace(0.0, _FIELD_RADIUS, round(_FIELD_RADIUS / (0.5 * _FIELD_STEP)) + 1)
    regular = np.arange(settings.march.start_plane, back, _FIELD_STEP)
    # The focal plane itself is one of the planes; its close neighbours are not.
    z = np.sort(np.append(regular[np.abs(regular - settings.focus) > 0.25 * _FIELD_STEP], settings.focus))
    field = compiled(lambda model: layered_field(model, protocol.start_temperature, protocol, settings, r=r, z=z))(
        model
    )
    return field_dataset(field, settings.focus)


def simulate_steps(
    model: Model, described: Experiment, settings: Discretisation, heating: Heating | None = None
) -> StepwiseResult:
    """The pushes of the experiment's protocol."""
    temperatures = jnp.asarray(step_temperatures(described))
    protocol = described.stepwise()
    run = compiled(lambda model, heating: run_stepwise(model, temperatures, protocol, settings, heating=heating))
    return run(model, heating)


def step_temperatures(described: Experiment) -> np.ndarray:
    """The protocol's temperatures [degC], with the one at which it is normalised among them."""
    return np.union1d(described.protocol.temperatures_c, [described.protocol.normalised_at_c])


def result_dataset(result: StepwiseResult, described: Experiment) -> xr.Dataset:
    """Displacement and lesion of every step."""
    return stepwise_dataset(result, described.stepwise(), described.protocol.normalised_at_c)


_HEADER = ("temperature [degC]", "time [s]", "lesion [mm]", "displacement [um]", "normalised [%]")


def _rows(data: xr.Dataset) -> list[tuple[str, ...]]:
    rows = []
    for step in data["step_temperature"].to_numpy():
        at = data.sel(step_temperature=step)
        lesion = f"{1e3 * float(at['lesion_length']):.1f} x {1e3 * float(at['lesion_diameter']):.1f}"
        rows.append(
            (
                f"{step:g}",
                f"{float(at['sonication_time']):.2f}",
                lesion,
                f"{1e6 * float(at['displacement']):.3f}",
                f"{float(at['displacement_percent']):.1f}",
            )
        )
    return rows


def _results(data: xr.Dataset, heating: Heating) -> dict[str, dict[str, Any]]:
    amplitude = data["pressure_amplitude_on_axis"]
    peak = int(np.argmax(amplitude.to_numpy()))
    return {
        "peak_pressure": quantity(float(amplitude[peak]), "Pa"),
        "peak_position": quantity(float(data["z"][peak]), "m"),
        "heating_acoustic_power": quantity(float(heating.acoustic_power), "W"),
        "step_temperature": {"value": data["step_temperature"].to_numpy().tolist(), "unit": "degC"},
        "displacement": {"value": data["displacement"].to_numpy().tolist(), "unit": "m"},
        "displacement_percent": {"value": data["displacement_percent"].to_numpy().tolist(), "unit": "percent"},
        "lesion_length": {"value": data["lesion_length"].to_numpy().tolist(), "unit": "m"},
        "lesion_diameter": {"value": data["lesion_diameter"].to_numpy().tolist(), "unit": "m"},
    }


def _report(described: Experiment, data: xr.Dataset, heating: Heating, figures: list[str], notes: list[str]) -> str:
    results, power = _results(data, heating), f"{data.attrs['acoustic_power_w']:g}"
    kind = "Linear field: peak" if data.attrs["n_harmonics"] == 1 else "Nonlinear field: fundamental up to"
    lines = [
        f"# {described.title}",
        "",
        f"{kind} {1e-6 * results['peak_pressure']['value']:.3f} MPa at "
        f"{1e3 * results['peak_position']['value']:.1f} mm from the apex, for {power} W of acoustic power. "
        f"A sonication of {described.protocol.sonication_s:g} s that ends at {described.protocol.temperatures_c[-1]:g} "
        f"degC takes {float(heating.acoustic_power):.1f} W. The field and the pushes are those of "
        f"{power} W.",
        "",
        "| " + " | ".join(_HEADER) + " |",
        "|" + " ---: |" * len(_HEADER),
        *("| " + " | ".join(row) + " |" for row in _rows(data)),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
