"""`arfjax push`: one push of heated tissue, followed while its shear wave runs out."""

from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np
import typer
import xarray as xr

import arfjax.figures
from arfjax import Experiment, InputError, WatchSettings, range_notes, read_experiment, simulate_heating, watch_push
from arfjax.io import push_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.notes import assumed_notes, grid_notes, heated_border_notes, sound_notes
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_SHORTEST_WATCH, _LONGEST_WATCH = 0.5, 50.0  # ms
_COURSES = {
    "none": "",
    "intensity": ", whose intensity is one period of a sine that ends at nothing,",
    "pressure": ", whose pressure amplitude is one period of a sine that ends at nothing,",
    "square": ", on for its middle half,",
}


def push_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    temperature_c: Annotated[
        float | None, typer.Option(help="Of the tissue [degC]; without it the last of the protocol's temperatures.")
    ] = None,
    watch_ms: Annotated[float, typer.Option(help="How long to follow it, from the start of the push [ms].")] = 8.0,
) -> None:
    """Push the heated liver once and follow it: displacement over time, maps, and when the shear wave arrives.

    Tissue, lesion and force are those that the experiment's protocol has when its focus comes to the temperature.

    Writes push.nc, a figure (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    assumed = assumed_notes(described, "mechanics", "lesion")
    temperature, watch = _checked(described, temperature_c, watch_ms)
    model, protocol = described.model(), described.stepwise()
    with output_directory(out) as folder:
        with progress_bar(3) as step:
            step("discretisation")
            settings = described.discretised(model)
            step("heating")
            heating = compiled(lambda model: simulate_heating(model, protocol, settings))(model)
            step("push")
            run = compiled(
                lambda model, at, heating: watch_push(model, at, protocol, settings, heating=heating, watch=watch)
            )
            result = run(model, jnp.asarray(temperature), heating)  # traced: without a lesion, its laws do not warn
        data = push_dataset(result, temperature)
        data.attrs |= {
            "title": described.title,
            "acoustic_power_w": float(model.drive.acoustic_power),
            "push_duration_s": protocol.push_duration,
            "push_modulation": described.protocol.push_modulation,
            "arfjax_version": arfjax.__version__,
        }
        write_netcdf(data, folder / "push.nc")
        drawn = arfjax.figures.draw_push(data, model, push_duration=protocol.push_duration)
        figures = write_figures(folder, {"push": drawn})
        notes = assumed + range_notes(model, np.asarray([temperature]), np.asarray([float(result.lesion.length)]))
        notes += heated_border_notes(heating, temperature)
        notes += sound_notes(settings, 1.0) + grid_notes(model)
        (folder / "report.md").write_text(_report(described, data, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="push",
            inputs=inputs,
            settings={"temperature_c": temperature, "watch_ms": watch_ms, "protocol": described.protocol.model_dump()},
            results=_results(data),
        )
    show_table(f"push at {temperature:g} degC", ("quantity", "value"), _rows(data))
    show_lines([*notes, f"written to {out}"])


def _checked(described: Experiment, temperature: float | None, watch_ms: float) -> tuple[float, WatchSettings]:
    temperatures = described.protocol.temperatures_c
    temperature = temperatures[-1] if temperature is None else temperature
    if not temperatures[0] <= temperature <= temperatures[-1]:  # what is not a number, too
        raise InputError(
            f"--temperature-c must lie between {temperatures[0]:g} and {temperatures[-1]:g} degC, where the "
            f"experiment's protocol goes, got {temperature:g}."
        )
    shortest = max(_SHORTEST_WATCH, described.protocol.push_ms)
    if not shortest <= watch_ms <= _LONGEST_WATCH:
        raise InputError(f"--watch-ms must be {shortest:g} (the push) to {_LONGEST_WATCH:g} ms, got {watch_ms:g}.")
    return temperature, WatchSettings(duration=1e-3 * watch_ms)


def _rows(data: xr.Dataset) -> list[tuple[str, str]]:
    results = _results(data)
    speed, last = results["shear_wave_speed"]["value"], results["followed_to"]["value"]
    wave = "has not passed" if speed is None else f"{speed:.2f} m/s, followed to r = {1e3 * last:.1f} mm"
    return [
        ("displacement at the focus at the end of the push", f"{1e6 * results['displacement']['value']:.3f} um"),
        (
            "largest displacement at the focus",
            f"{1e6 * results['largest_displacement']['value']:.3f} um at "
            f"{1e3 * results['time_of_largest']['value']:.2f} ms",
        ),
        (
            "lesion",
            f"{1e3 * results['lesion_length']['value']:.1f} x {1e3 * results['lesion_diameter']['value']:.1f} mm",
        ),
        ("shear wave in the focal plane", wave),
    ]


def _results(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    course, time = data["focal_displacement"].to_numpy(), data["course_time"].to_numpy()
    highest = int(np.argmax(course))
    end = int(np.argmin(np.abs(time - data.attrs["push_duration_s"])))
    speed, arrived = data.attrs["shear_wave_speed_m_s"], np.isfinite(data["shear_wave_arrival"].to_numpy())
    reached = float(data["r"].to_numpy()[arrived][-1]) if arrived.any() else 0.0
    return {
        "displacement": quantity(float(course[end]), "m"),
        "largest_displacement": quantity(float(course[highest]), "m"),
        "time_of_largest": quantity(float(time[highest]), "s"),
        "shear_wave_speed": {"value": float(speed) if np.isfinite(speed) else None, "unit": "m s-1"},
        "followed_to": quantity(reached, "m"),
        "lesion_length": quantity(data.attrs["lesion_length_m"], "m"),
        "lesion_diameter": quantity(data.attrs["lesion_diameter_m"], "m"),
    }


def _report(described: Experiment, data: xr.Dataset, figures: list[str], notes: list[str]) -> str:
    lines = [
        f"# {described.title}: one push",
        "",
        f"A push of {1e3 * data.attrs['push_duration_s']:g} ms{_COURSES[described.protocol.push_modulation]} by "
        f"{data.attrs['acoustic_power_w']:g} W of acoustic power at {data.attrs['temperature_degc']:g} degC.",
        "",
        "| quantity | value |",
        "| --- | ---: |",
        *("| " + " | ".join(row) + " |" for row in _rows(data)),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
