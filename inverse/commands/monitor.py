"""`arfjax monitor`: a sonication watched while it heats, displacement beside temperature and lesion."""

from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np
import typer
import xarray as xr

import arfjax.figures
from arfjax import (
    AdaptiveSteps,
    Experiment,
    FixedSteps,
    InputError,
    TransientProtocol,
    read_experiment,
    run_transient,
)
from arfjax.io import transient_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from arfjax.protocols.transient import first_reached
from arfjax.thermal.bioheat import border_rise
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.notes import (
    WATCHED,
    assumed_notes,
    boiling_notes,
    border_notes,
    grid_notes,
    heated_range_notes,
    lesion_range_notes,
    modulation_notes,
    sound_notes,
)
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_HOTTEST_RESOLVED = 85.0  # degC; what the elements of steady shaking are chosen for


def monitor_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML); assumed is what it does not say.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
) -> None:
    """Simulate what a monitor of displacement would show during one sonication, and the temperature beside it.

    The sonication's power is the mean; a modulated beam is stronger at times and pushes harder. Field, heat, dose,
    moduli and motion are coupled in time, and temperature varies in space. Writes monitoring.nc, curves.csv, a figure
    (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    monitoring, mean_power = described.monitoring, float(described.sonicated().drive.acoustic_power)
    model = described.model_at(mean_power / monitoring.mean_force())
    assumed = assumed_notes(described, *WATCHED, power=mean_power)
    with output_directory(out) as folder:
        with working("watched sonication (the first run compiles)"):
            settings = described.discretised(model, described.sonication.start_temperature_c)
            probe = monitoring.plan(model, settings, _HOTTEST_RESOLVED)
            protocol = TransientProtocol(
                described.sonication.plan(),
                probe,
                monitoring.tolerance_k,
                described.sonication.thermocouple.instrument(),
                monitoring.tracking.tracker(settings.focus),
            )
            steps = AdaptiveSteps() if described.sonication.steps == "adaptive" else FixedSteps()
            result = compiled(lambda model: run_transient(model, protocol, settings, steps=steps))(model)
            if not bool(result.sonication.effort.converged):
                raise InputError(
                    f"{experiment}: temperatures grow without bound, or steps would have to become too short; lower "
                    "`sonication.acoustic_power_w` or `sonication.step_s`."
                )
            shown = np.asarray(result.thermocouple_temperature)
            data = transient_dataset(result, settings, probe.mesh(settings), _reference(described, shown))
        data.attrs |= {
            "title": described.title,
            "acoustic_power_w": float(model.drive.acoustic_power),
            "mean_acoustic_power_w": mean_power,
            "probe": monitoring.words(),
            "arfjax_version": arfjax.__version__,
        }
        write_netcdf(data, folder / "monitoring.nc")
        curves = data.drop_dims(["heat_r", "heat_z", "probe_r", "probe_z"])
        curves.to_dataframe().to_csv(folder / "curves.csv")
        figures = write_figures(folder, {"monitoring": arfjax.figures.draw_monitoring(data)})
        notes = assumed + boiling_notes(result.sonication.boiling_time)
        notes += lesion_range_notes(model, result.sonication)
        notes += heated_range_notes(model, described, settings, result.sonication)
        notes += border_notes(border_rise(result.sonication.temperature))
        notes += sound_notes(settings, *(phase.relative_power for phase in described.sonication.phases))
        notes += modulation_notes(settings, monitoring)
        notes += grid_notes(model, described.sonication.duration_s)
        (folder / "report.md").write_text(_report(data, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="monitor",
            inputs=inputs,
            settings={
                "sonication": described.sonication.model_dump(),
                "monitoring": monitoring.model_dump(),
            },
            results=_results(data),
        )
    show_table("watched sonication", ("quantity", "value"), _rows(data))
    show_lines([*notes, f"written to {out}"])


def _reference(described: Experiment, shown: np.ndarray) -> float:
    """Temperature [degC] of 100 percent: the file's, or the first that the thermocouple shows."""
    wanted = described.monitoring.normalised_at_c
    if wanted is None:
        return float(shown[0])
    # By the rule of the result's own normalisation, which allows for rounding.
    if not np.isfinite(first_reached(jnp.asarray(shown), wanted)[1]):
        raise InputError(
            f"`monitoring.normalised_at_c` {wanted:g}: the thermocouple shows {shown[0]:.1f} to {shown.max():.1f} degC "
            "only; name a temperature in between, or change the power."
        )
    return wanted


def _telling(data: xr.Dataset) -> dict[str, float]:
    percent = data["tracked_displacement_percent"].to_numpy()
    time, temperature = (data[name].to_numpy() for name in ("heating_time", "thermocouple_temperature"))
    size = data["lesion_length"].to_numpy()
    highest = int(np.argmax(percent))
    lethal = np.flatnonzero(size > 0.0)
    return {
        "first": 1e6 * float(data["tracked_displacement"][0]),
        "last": float(percent[-1]),
        "highest": float(percent[highest]),
        "at": float(temperature[highest]),
        "lesion_time": float(time[lethal[0]]) if lethal.size else np.nan,
        "lesion_percent": float(percent[lethal[0]]) if lethal.size else np.nan,
    }


def _rows(data: xr.Dataset) -> list[tuple[str, str]]:
    telling, last = _telling(data), data.isel(heating_time=-1)
    seen = "never"
    if np.isfinite(telling["lesion_time"]):
        seen = f"{telling['lesion_time']:g} s, displacement {telling['lesion_percent']:.1f} %"
    reference = data.attrs["reference_temperature_degc"]
    length, diameter = (1e3 * float(last[name]) for name in ("lesion_length", "lesion_diameter"))
    return [
        ("displacement at the start, tracked", f"{telling['first']:.3f} um"),
        (f"highest displacement, of that at {reference:g} degC", f"{telling['highest']:.1f} %"),
        ("the thermocouple shows then", f"{telling['at']:.1f} degC"),
        ("displacement at the end", f"{telling['last']:.1f} %"),
        ("lesion appears at", seen),
        (
            "lesion at the end",
            f"{1e3 * float(last['lesion_length']):.2f} x {1e3 * float(last['lesion_diameter']):.2f} mm",
        ),
        (
            "highest temperature that the thermocouple shows",
            f"{float(data['thermocouple_temperature'].max()):.1f} degC",
        ),
        ("displacement computed", f"{int(data['probed_anew'].sum())} times"),
        ("field computed again", f"{int(last['field_updates'])} times"),
    ]


def _results(data: xr.Dataset) -> dict[str, dict[str, Any]]:
    telling, last = _telling(data), data.isel(heating_time=-1)
    return {
        "start_displacement": quantity(1e-6 * telling["first"], "m"),
        "highest_displacement": quantity(telling["highest"], "percent"),
        "temperature_of_highest_displacement": quantity(telling["at"], "degC"),
        "end_displacement": quantity(telling["last"], "percent"),
        "lesion_time": quantity(telling["lesion_time"], "s"),
        "lesion_length": quantity(float(last["lesion_length"]), "m"),
        "lesion_diameter": quantity(float(last["lesion_diameter"]), "m"),
    }


def _report(data: xr.Dataset, figures: list[str], notes: list[str]) -> str:
    attributes = data.attrs
    lines = [
        f"# {attributes['title']}: a watched sonication",
        "",
        f"{attributes['acoustic_power_w']:g} W of acoustic power at the beam's strongest, "
        f"{attributes['mean_acoustic_power_w']:.3g} W in the mean. Displacement by {attributes['probe']}, at the "
        "geometric focus; temperature as the thermocouple shows it.",
        "",
        "| quantity | value |",
        "| --- | ---: |",
        *("| " + " | ".join(row) + " |" for row in _rows(data)),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
