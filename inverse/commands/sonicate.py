"""`arfjax sonicate`: one sonication in which heat changes tissue, field and heat again."""

from pathlib import Path
from typing import Annotated, Any

import jax.numpy as jnp
import numpy as np
import typer
import xarray as xr

import arfjax.figures
from arfjax import (
    LETHAL_DOSE_MINUTES,
    AdaptiveSteps,
    Discretisation,
    Experiment,
    FixedSteps,
    InputError,
    LesionSize,
    Model,
    SonicationResult,
    TemperatureHistory,
    lesion_size,
    read_experiment,
    smoothed_lesion_size,
    sonicate,
    sonication_field,
)
from arfjax.io import field_dataset, sonication_dataset, write_netcdf
from arfjax.numerics.compiled import compiled
from arfjax.thermal.bioheat import border_rise
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.notes import (
    assumed_notes,
    boiling_notes,
    border_notes,
    grid_notes,
    heated_range_notes,
    sound_notes,
)
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_SHOWN_RADIUS = 8e-3  # m
_SHOWN_REACH = 13e-3  # m
_SHOWN_STEP = 0.125e-3  # m
_SMOOTH = 0.5  # width of the smooth threshold in the logarithm of dose; what it does to the size is reported


def sonicate_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML); without a [sonication] one is assumed.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
) -> None:
    """Simulate one sonication: temperature, dose, damage, lesion growth, and what a thermocouple would show.

    Writes sonication.nc, force.nc, figures (PNG and PDF), curves.csv, report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    model = described.sonicated()
    assumed = assumed_notes(described, "sonication", power=model.drive.acoustic_power)
    with output_directory(out) as folder:
        with working("sonication (the first run compiles)") as say:
            settings = described.discretised(model, described.sonication.start_temperature_c)
            result = run_sonication(model, described, settings)
            if not bool(result.effort.converged):
                raise InputError(
                    f"{experiment}: temperatures grow without bound, or steps would have to become too short; lower "
                    "`sonication.acoustic_power_w` or `sonication.step_s`."
                )
            say("thermocouple and force")
            data = sonication_dataset(
                result, settings.heat_grid, settings.focus, thermocouple_reading(model, described, settings, result)
            )
            hottest = int(np.argmax(data["peak_temperature"].to_numpy()))
            force = force_dataset(model, described, settings, result, hottest)
        data.attrs |= {"title": described.title, "acoustic_power_w": float(model.drive.acoustic_power)}
        write_netcdf(data, folder / "sonication.nc")
        write_netcdf(force, folder / "force.nc")
        curves = data.drop_dims(["heat_r", "heat_z"]).to_dataframe()
        curves.to_csv(folder / "curves.csv")
        figures = write_figures(
            folder,
            {
                "course": arfjax.figures.draw_sonication(data),
                "maps": arfjax.figures.draw_temperature_maps(data, model, shown_times(data)),
                "lesion_on_force": arfjax.figures.draw_lesion_on_force(force, data.isel(heating_time=hottest), model),
            },
        )
        notes = assumed + notes_on(model, described, settings, result)
        notes += sound_notes(settings, *(phase.relative_power for phase in described.sonication.phases))
        notes += grid_notes(model, described.sonication.duration_s)
        rows = _rows(data, result, settings)
        (folder / "report.md").write_text(_report(described, settings, rows, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="sonicate",
            inputs=inputs,
            settings={"sonication": described.sonication.model_dump()},
            results=_results(data, result),
        )
    show_table("sonication", ("quantity", "value"), rows)
    show_lines([*notes, f"written to {out}"])


def run_sonication(model: Model, described: Experiment, settings: Discretisation) -> SonicationResult:
    """The sonication that an experiment file describes."""
    plan = described.sonication.plan()
    steps = AdaptiveSteps() if described.sonication.steps == "adaptive" else FixedSteps()
    return compiled(lambda model: sonicate(model, plan, settings, steps=steps))(model)


def thermocouple_reading(
    model: Model, described: Experiment, settings: Discretisation, result: SonicationResult
) -> Any:
    """What the experiment's thermocouple would show [degC]."""
    capacity = settings.thermal_field(model, described.sonication.start_temperature_c).heat_capacity
    return described.sonication.thermocouple.instrument()(
        TemperatureHistory(result.time, result.temperature),
        settings.heat_grid,
        z=settings.focus,
        heat=result.heat,
        heat_capacity=capacity,
    )


def force_dataset(
    model: Model, described: Experiment, settings: Discretisation, result: SonicationResult, index: int
) -> xr.Dataset:
    """The field about the focus at full power, in the tissue of one output time."""
    r = np.arange(0.0, _SHOWN_RADIUS, _SHOWN_STEP)
    about = settings.focus + np.arange(-_SHOWN_REACH, _SHOWN_REACH, 2.0 * _SHOWN_STEP)
    back = model.liver_depth + model.liver_thickness
    z = about[(about >= settings.march.start_plane) & (about <= back)]
    plan = described.sonication.plan()
    temperature, dose = result.temperature[index], result.dose[index]
    if described.sonication.field == "frozen":
        temperature, dose = jnp.full_like(temperature, plan.start_temperature), jnp.zeros_like(dose)
    field = compiled(
        lambda model, temperature, dose: sonication_field(model, plan, settings, temperature, dose, r=r, z=z)
    )(model, temperature, dose)
    return field_dataset(field, settings.focus)


def shown_times(data: xr.Dataset) -> list[float]:
    """Six output times [s]: four up to the hottest moment, two after it where there is an after."""
    time = data["heating_time"].to_numpy()
    hottest = time[int(np.argmax(data["peak_temperature"].to_numpy()))]
    wanted = [0.1 * hottest, 0.3 * hottest, 0.6 * hottest, hottest]
    if hottest < time[-1]:
        wanted += [hottest + share * (time[-1] - hottest) for share in (0.2, 1.0)]
    return sorted({float(time[np.argmin(np.abs(time - each))]) for each in wanted})


def notes_on(model: Model, described: Experiment, settings: Discretisation, result: SonicationResult) -> list[str]:
    """What a reader must know: boiling, heat at the border of the grid, laws beyond their range."""
    notes = boiling_notes(result.boiling_time)
    notes += border_notes(border_rise(result.temperature))
    return notes + heated_range_notes(model, described, settings, result)


def _rows(data: xr.Dataset, result: SonicationResult, settings: Discretisation) -> list[tuple[str, str]]:
    last, grid = data.isel(heating_time=-1), settings.heat_grid
    by_name = {name: float(data[name].max()) for name in ("focal_temperature", "peak_temperature")}
    shown = float(data["thermocouple_temperature"].max())
    lethal = data["heating_time"].to_numpy()[data["lesion_length"].to_numpy() > 0.0]
    dose = lesion_size(result.dose[-1], grid)
    smooth = smoothed_lesion_size(result.dose[-1], grid, threshold=LETHAL_DOSE_MINUTES, width=_SMOOTH)
    effort = result.effort
    return [
        ("highest temperature at the focus [degC]", f"{by_name['focal_temperature']:.1f}"),
        ("highest temperature anywhere [degC]", f"{by_name['peak_temperature']:.1f}"),
        ("highest temperature that the thermocouple shows [degC]", f"{shown:.1f}"),
        ("dose at the focus at the end [min]", f"{float(last['focal_dose']):.4g}"),
        ("lesion appears at [s]", f"{lethal[0]:g}" if lethal.size else "never"),
        ("lesion by dose, length x diameter [mm]", _size(dose)),
        ("the same with the smooth threshold of fits [mm]", _size(smooth)),
        ("lesion by Arrhenius damage [mm]", _size(lesion_size(result.damage[-1], grid, threshold=1.0))),
        ("lesion by dose, volume [mm3]", f"{1e9 * float(dose.volume):.2f}"),
        ("field computed again", f"{int(last['field_updates'])} times"),
        ("time steps", f"{int(effort.n_steps)}"),
        ("largest error of a step's first stage [K]", f"{float(effort.error):.2g}"),
    ]


def _size(lesion: LesionSize) -> str:
    return f"{1e3 * float(lesion.length):.2f} x {1e3 * float(lesion.diameter):.2f}"


def _results(data: xr.Dataset, result: SonicationResult) -> dict[str, dict[str, Any]]:
    last = data.isel(heating_time=-1)
    return {
        "highest_focal_temperature": quantity(float(data["focal_temperature"].max()), "degC"),
        "highest_temperature": quantity(float(data["peak_temperature"].max()), "degC"),
        "highest_thermocouple_temperature": quantity(float(data["thermocouple_temperature"].max()), "degC"),
        "focal_dose": quantity(float(last["focal_dose"]), "min"),
        "lesion_length": quantity(float(last["lesion_length"]), "m"),
        "lesion_diameter": quantity(float(last["lesion_diameter"]), "m"),
        "lesion_volume": quantity(float(last["lesion_volume"]), "m3"),
        "boiling_time": quantity(float(result.boiling_time), "s"),
        "field_updates": quantity(float(last["field_updates"]), "1"),
        "time_steps": quantity(float(result.effort.n_steps), "1"),
    }


def _report(
    described: Experiment, settings: Discretisation, rows: list[tuple[str, str]], figures: list[str], notes: list[str]
) -> str:
    section = described.sonication
    power = float(described.sonicated().drive.acoustic_power)
    kind = "linear" if settings.march.n_harmonics == 1 else "nonlinear"
    field = (
        f"computed again every {section.field_tolerance_k:g} K" if section.field == "updated" else "that of the start"
    )
    lines = [
        f"# {described.title}: sonication",
        "",
        f"{power:g} W of acoustic power from {section.start_temperature_c:g} degC in {len(section.phases)} phases; the "
        f"{kind} field is {field}. Damage by the default Arrhenius law of liver beside thermal dose (CEM43).",
        "",
        "| quantity | value |",
        "| --- | ---: |",
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
        *(f"- {note}" for note in notes),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"
