"""`arfjax field`: the sound field of an experiment, nonlinear and to a tolerance, with all that it can tell."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import xarray as xr
from jaxtyping import Float

import arfjax.figures
from arfjax import Discretisation, Experiment, InputError, Model, discretise, extrapolations, read_experiment
from arfjax.io import full_field_dataset, write_netcdf
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.notes import grid_notes
from inverse.output import output_directory, quantity, recorded, write_figures, write_summary

_RADIUS = 20e-3  # m
_STEP = 0.25e-3  # m; half of it across the axis and about the focus, a quarter across it near the axis
_REACH = 4e-3  # m
_NEAR = 3e-3  # m
_LOWEST_POWER, _HIGHEST_POWER = 1e-3, 1e4  # W


def field_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    power_w: Annotated[
        float | None, typer.Option(help="Acoustic power [W]; without it that of the experiment file.")
    ] = None,
) -> None:
    """Compute the sound field: harmonics, peak pressures, waveforms, heat, radiation force, and where the power goes.

    It obeys the file's [acoustics]; where that does not say whether sound is nonlinear, here it is. Harmonics and steps
    are chosen to its tolerance, 0.001 by default, and the report says whether it was reached. Tissue is at the first
    of the protocol's temperatures.

    Writes field.nc, figures (PNG and PDF), report.md and summary.json into the folder `out`.
    """
    described = read_experiment(experiment)
    inputs = recorded({"experiment": experiment})
    model, temperature = _model(described, power_w), described.protocol.temperatures_c[0]
    with output_directory(out) as folder:
        with working("sound field") as say:
            r, z = positions(model, discretise(model))
            field, settings = described.acoustics.solve(
                model, temperature, r=r, z=z, say=lambda what: say(f"sound field: {what}")
            )
            if not bool(np.all(np.isfinite(np.asarray(field.pressure)))):
                raise InputError(
                    f"{experiment}: the sound field grows without bound; take fewer `acoustics.harmonics`, or leave "
                    "them out and they are chosen."
                )
            say("peaks, heat and force")
            data = full_field_dataset(field, settings.focus, tolerance=described.acoustics.tolerance)
        data.attrs |= _provenance(described, model, settings, temperature)
        write_netcdf(data, folder / "field.nc")
        figures = write_figures(
            folder,
            {
                "field": arfjax.figures.draw_field(data, model),
                "sound": arfjax.figures.draw_sound(data, model),
            },
        )
        notes = [_verdict(data), *_notes(model, temperature), *grid_notes(model)]
        rows = _rows(data)
        (folder / "report.md").write_text(_report(described, data, rows, figures, notes), encoding="utf-8")
        write_summary(
            folder,
            command="field",
            inputs=inputs,
            settings={"acoustics": described.acoustics.model_dump(), "power_w": power_w, "chosen": _chosen(settings)},
            results=_results(data),
        )
    show_table("sound field", ("quantity", "value"), rows)
    show_lines([*notes, f"written to {out}"])


def positions(model: Model, settings: Discretisation) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, " z"]]:
    """Radii and depths [m] at which the field is shown, the focal plane among them."""
    start, back = settings.march.start_plane, model.liver_depth + model.liver_thickness
    radius = min(_RADIUS, settings.march.sponge_start * settings.march.domain_radius)
    fine = settings.focus + 0.5 * _STEP * np.arange(-round(2 * _REACH / _STEP), round(2 * _REACH / _STEP) + 1)
    fine = fine[(fine >= start) & (fine <= back)]
    coarse = np.arange(start, back, _STEP)
    coarse = coarse[(coarse < fine[0] - 0.25 * _STEP) | (coarse > fine[-1] + 0.25 * _STEP)]
    r = np.concatenate([0.25 * _STEP * np.arange(round(4.0 * _NEAR / _STEP)), np.arange(_NEAR, radius, 0.5 * _STEP)])
    return r, np.sort(np.concatenate([coarse, fine]))


def _model(described: Experiment, power: float | None) -> Model:
    if power is None:
        return described.model()
    if not _LOWEST_POWER <= power <= _HIGHEST_POWER:  # what is not a number, too
        raise InputError(f"--power-w must be {_LOWEST_POWER:g} to {_HIGHEST_POWER:g} W, got {power:g}.")
    return described.model_at(power)


def _provenance(
    described: Experiment, model: Model, settings: Discretisation, temperature: float
) -> dict[str, str | float]:
    return {
        "title": described.title,
        "acoustic_power_w": float(model.drive.acoustic_power),
        "temperature_degc": temperature,
        "layers": ", ".join(f"{section.tissue} {section.thickness_mm:g} mm" for section in described.layers),
        "diffraction": f"{described.acoustics.diffraction}, source {described.acoustics.source}",
        **{f"march_{name}": value for name, value in _chosen(settings).items()},
        "arfjax_version": arfjax.__version__,
    }


def _chosen(settings: Discretisation) -> dict[str, float | int]:
    march = settings.march
    return {
        "n_harmonics": march.n_harmonics,
        "n_radial": march.n_radial,
        "axial_step_m": march.axial_step,
        "n_substeps": march.n_substeps,
    }


def _verdict(data: xr.Dataset) -> str:
    """Whether the tolerance was reached, in a sentence."""
    tolerance, statement = data.attrs["tolerance"], data.attrs["tolerance_statement"]
    shock = data.attrs["convergence_shock_fraction"]
    if statement == "reached":
        return f"the tolerance of {tolerance:g} is reached, by the solution's own estimates of its errors."
    said = f"the tolerance of {tolerance:g} is {statement}."
    if shock > 0.2:
        said += " There is a shock thinner than the harmonics resolve: heat is right, the peak within 1 to 3 percent."
    return said


def _notes(model: Model, temperature: float) -> list[str]:
    return [
        note
        for layer in model.layers
        for note in extrapolations(layer.tissue, np.asarray([temperature]), name="tissue")
    ]


def _rows(data: xr.Dataset) -> list[tuple[str, str]]:
    told = data.attrs
    r, z = 1e3 * told["peak_positive_pressure_r_m"], 1e3 * told["peak_positive_pressure_z_m"]
    place = f"z = {z:.2f} mm" + (f", r = {r:.2f} mm" if r > 0.0 else "")
    heat = data["heat_deposition"]
    hottest = heat.isel(heat.argmax(...))
    harmonics = ", ".join(f"{1e-6 * each:.3f}" for each in data["focal_spectrum"].to_numpy()[:5])
    return [
        ("highest positive pressure", f"{1e-6 * told['peak_positive_pressure_pa']:.3f} MPa at {place}"),
        ("lowest negative pressure", f"{1e-6 * told['peak_negative_pressure_pa']:.3f} MPa"),
        (
            "harmonics 1 to 5 at the geometric focus" if "," in harmonics else "amplitude at the geometric focus",
            f"{harmonics} MPa",
        ),
        ("harmonics carried", f"{told['n_harmonics']}"),
        (
            "highest intensity (spatial peak, temporal average)",
            f"{1e-4 * told['spatial_peak_temporal_average_intensity_w_m2']:.0f} W/cm2",
        ),
        ("highest heat deposition", f"{1e-6 * float(hottest):.1f} W/cm3 at z = {1e3 * float(hottest['z']):.2f} mm"),
        ("highest radiation force density", f"{1e-3 * float(data['radiation_force_density'].max()):.1f} kN/m3"),
        (
            "the same by 2 alpha I / c differs by",
            f"{100.0 * told['radiation_force_of_intensity_relative_difference']:+.2f} %",
        ),
        (
            "estimated errors (harmonics, radial, axial)",
            ", ".join(f"{told[f'convergence_{name}']:.1e}" for name in ("harmonics", "radial", "axial")),
        ),
        ("shock fraction", f"{told['convergence_shock_fraction']:.1e}"),
    ]


def _results(data: xr.Dataset) -> dict[str, Any]:
    told = data.attrs
    named = {
        "peak_positive_pressure": ("peak_positive_pressure_pa", "Pa"),
        "peak_positive_pressure_position": ("peak_positive_pressure_z_m", "m"),
        "peak_positive_pressure_radius": ("peak_positive_pressure_r_m", "m"),
        "peak_negative_pressure": ("peak_negative_pressure_pa", "Pa"),
        "peak_intensity": ("spatial_peak_temporal_average_intensity_w_m2", "W m-2"),
        "peak_heat_deposition": ("peak_heat_deposition_w_m3", "W m-3"),
        "radiation_force_of_intensity_relative_difference": ("radiation_force_of_intensity_relative_difference", "1"),
    }
    powers = ("entering_power", "leaving_power", "reflected_power", "lost_power")
    return {
        **{name: quantity(told[key], unit) for name, (key, unit) in named.items()},
        "focal_harmonics": {"value": data["focal_spectrum"].to_numpy().tolist(), "unit": "Pa"},
        **{name: {"value": data[name].to_numpy().tolist(), "unit": "W"} for name in powers},
        "convergence": {key.removeprefix("convergence_"): told[key] for key in told if key.startswith("convergence_")},
        "tolerance": told["tolerance"],
        "tolerance_statement": told["tolerance_statement"],
    }


def _report(
    described: Experiment, data: xr.Dataset, rows: list[tuple[str, str]], figures: list[str], notes: list[str]
) -> str:
    told = data.attrs
    kind = "Nonlinear" if told["n_harmonics"] > 1 else "Linear"
    lines = [
        f"# {described.title}: sound field",
        "",
        f"{kind} field of {told['acoustic_power_w']:g} W of acoustic power at {1e-6 * told['fundamental_hz']:g} MHz in "
        f"{told['layers']}, all at {told['temperature_degc']:g} degC. Diffraction: {told['diffraction']}.",
        "",
        notes[0][0].upper() + notes[0][1:],
        "",
        "| quantity | value |",
        "| --- | ---: |",
        *("| " + " | ".join(row) + " |" for row in rows),
        "",
        *power_lines(described, data),
        *(f"- {note}" for note in notes[1:]),
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"


def power_lines(described: Experiment, data: xr.Dataset) -> list[str]:
    """Lines of the report that say where the power goes."""
    return [
        "Where the power goes [W]; the first layer is counted from the plane where the march starts.",
        "",
        "| layer | enters | kept back at its front | lost inside | leaves |",
        "| --- | ---: | ---: | ---: | ---: |",
        *_power_rows(described, data),
        "",
        "What is kept back at a front does not get past it: the march reflects at all angles what it would at normal "
        "incidence, refraction adds to it or makes up for it, and it may be below zero.",
        "",
    ]


def _power_rows(described: Experiment, data: xr.Dataset) -> list[str]:
    columns = (data[name].to_numpy() for name in ("entering_power", "reflected_power", "lost_power", "leaving_power"))
    return [
        f"| {section.tissue}, {section.thickness_mm:g} mm | " + " | ".join(f"{watts:.3f}" for watts in powers) + " |"
        for section, *powers in zip(described.layers, *columns, strict=False)
    ]
