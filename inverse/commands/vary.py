"""`arfjax vary`: a protocol in tissue that varies, as bands of its curve and the constants that make them."""

import dataclasses
import enum
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
import xarray as xr

import arfjax
from arfjax import AdaptiveSteps, Discretisation, Experiment, FixedSteps, InputError, Model, read_experiment
from arfjax import TransientProtocol as WatchedSonication
from arfjax.io import COORDINATES, VARIABLES, write_netcdf
from inverse.commands.console import progress_bar, show_lines, show_table
from inverse.commands.notes import (
    WATCHED,
    assumed_notes,
    boiling_notes,
    border_notes,
    central_range_notes,
    grid_notes,
    modulation_notes,
    scaling_notes,
    sound_notes,
)
from inverse.commands.partial import PartialFile, StoppedEarly
from inverse.commands.variability_report import HEADER, report, results, rows
from inverse.figures import draw_bands, draw_sensitivity
from inverse.monte_carlo import SPREADS, analyse, draw_factors, run_samples, stepwise_outcome, transient_outcome
from inverse.monte_carlo.bands import curves_by_temperature, levels_of
from inverse.monte_carlo.runs import Outcome
from inverse.output import output_directory, recorded, write_figures, write_summary
from inverse.seeds import HIGHEST_SEED
from inverse.software import versions

_STEP_K = 2.5  # between temperatures of the stepwise curve
_HOTTEST_RESOLVED = 85.0  # degC; what the elements of steady shaking are chosen for


class VariedProtocol(enum.StrEnum):
    """What is run for every sample."""

    STEPWISE = "stepwise"
    TRANSIENT = "transient"


@dataclasses.dataclass(frozen=True)
class Task:
    """One protocol, ready to be run in any tissue.

    Attributes:
        model: With the central constants.
        settings: Of the central model; all samples share its grids and elements.
        outcome: What the protocol makes of a model.
        temperatures: Of the curve [degC]; None where they are what the samples reach.
        start: Temperature of the tissue at the start [degC].
        reference: Temperature of 100 percent [degC].
        displacement: Name of the displacement that is analysed.
        temperature_label: What the curve's temperature is.
        chunk: Samples between two savings.
        notes: What is to be said about the runs.
    """

    model: Model
    settings: Discretisation
    outcome: Outcome
    temperatures: np.ndarray | None
    start: float
    reference: float
    displacement: str
    temperature_label: str
    chunk: int
    notes: tuple[str, ...]


def vary_command(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    samples: Annotated[int, typer.Option(help="Draws of the tissue's constants.", min=2, max=100_000)] = 200,
    protocol: Annotated[
        VariedProtocol, typer.Option(help="The file's [protocol], or its watched sonication.")
    ] = VariedProtocol.STEPWISE,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0, max=HIGHEST_SEED)] = 0,
) -> None:
    """Run a protocol in many tissues, whose constants spread as measured or assumed, and say how its curve spreads.

    Constants are drawn around the file's by Latin hypercube sampling. A run that is stopped goes on where it was when
    the same command is given again. Writes variability.nc, curves.csv, bands.csv, figures (PNG and PDF), report.md and
    summary.json into the folder `out`.
    """
    described, inputs = read_experiment(experiment), recorded({"experiment": experiment})
    drawn = draw_factors(SPREADS, samples, seed)
    factors = np.concatenate([np.ones((1, drawn.shape[1])), drawn])
    task = _stepwise_task(described) if protocol is VariedProtocol.STEPWISE else _transient_task(described)
    settings = {"protocol": str(protocol), "samples": samples, "sampling": "Latin hypercube"}
    digests = {"experiment": inputs["experiment"]["sha256"], "factors": hashlib.sha256(factors.tobytes()).hexdigest()}
    partial = PartialFile(out, settings | {"seed": seed} | digests | versions())
    try:
        with output_directory(out) as folder:
            outcomes = _run(task, factors, partial)
            data = _dataset(task, factors, outcomes)
            task = dataclasses.replace(task, notes=(*task.notes, *_central_notes(task, outcomes)))
            data.attrs |= {
                "title": described.title,
                "protocol": str(protocol),
                "temperature": task.temperature_label,
                "seed": seed,
                "sampling": "Latin hypercube",
                "acoustic_power_w": float(task.model.drive.acoustic_power),
                "arfjax_version": arfjax.__version__,
            }
            _write(folder, data, task)
            write_summary(
                folder,
                command="vary",
                inputs=inputs,
                settings=settings,
                results=results(data),
                seed=seed,
            )
    except KeyboardInterrupt:
        if not partial.path.exists():
            raise
        raise StoppedEarly(partial.words()) from None
    partial.delete()
    show_table(f"displacement in {samples} tissues", HEADER, rows(data))
    show_lines([*task.notes, f"written to {out}"])


def _stepwise_task(described: Experiment) -> Task:
    model = described.model()
    assumed = assumed_notes(described, "mechanics", "lesion")
    settings = described.discretised(model)
    given, reference = described.protocol.temperatures_c, described.protocol.normalised_at_c
    temperatures = curve_temperatures(given, reference)
    return Task(
        model=model,
        settings=settings,
        outcome=stepwise_outcome(described.stepwise(), temperatures.tolist(), settings),
        temperatures=temperatures,
        start=given[0],
        reference=reference,
        displacement="displacement",
        temperature_label="temperature of liver and focus",
        chunk=20,
        notes=(*assumed, *sound_notes(settings), *grid_notes(model)),
    )


def curve_temperatures(given: Sequence[float], reference: float) -> np.ndarray:
    """Temperatures [degC] of the stepwise curve: the protocol's, that of 100 percent, and steps between them."""
    # Multiples of the step are added, because `arange` with a start that is no binary number misses those given by
    # rounding, which would then be there twice.
    n_steps = int((given[-1] - given[0]) / _STEP_K + 1e-9)
    return np.union1d(given[0] + _STEP_K * np.arange(n_steps + 1), [*given, reference])


def _transient_task(described: Experiment) -> Task:
    sonication, monitoring = described.sonication, described.monitoring
    mean_power = float(described.sonicated().drive.acoustic_power)
    model = described.model_at(mean_power / monitoring.mean_force())
    assumed = assumed_notes(described, *WATCHED, power=mean_power)
    start = sonication.start_temperature_c
    reference = start if monitoring.normalised_at_c is None else monitoring.normalised_at_c
    if reference < start:
        raise InputError(
            f"`monitoring.normalised_at_c` {reference:g} lies below `sonication.start_temperature_c` {start:g}, which "
            "no tissue is ever colder than; raise it, or leave it out."
        )
    settings = described.discretised(model, start)
    probe = monitoring.plan(model, settings, _HOTTEST_RESOLVED)
    watched = WatchedSonication(
        sonication.plan(),
        probe,
        monitoring.tolerance_k,
        sonication.thermocouple.instrument(),
        monitoring.tracking.tracker(settings.focus),
    )
    steps = AdaptiveSteps() if sonication.steps == "adaptive" else FixedSteps()
    return Task(
        model=model,
        settings=settings,
        outcome=transient_outcome(model, watched, settings, steps=steps),
        temperatures=None,
        start=start,
        reference=reference,
        displacement="tracked_displacement",
        temperature_label="temperature that the thermocouple first shows",
        chunk=2,
        notes=(
            *assumed,
            f"displacement by {monitoring.words()}; elements are those that the central constants need.",
            *sound_notes(settings, *(phase.relative_power for phase in sonication.phases)),
            *modulation_notes(settings, monitoring),
            *grid_notes(model, sonication.duration_s),
        ),
    )


def _run(task: Task, factors: np.ndarray, partial: PartialFile) -> dict[str, np.ndarray]:
    """Outcomes of all samples, those of an earlier run that was stopped among them."""
    outcomes = partial.load()
    n_done, n_all = PartialFile.n_done(outcomes), len(factors)
    with progress_bar(-(-(n_all - n_done) // task.chunk)) as step:
        step(f"{n_done} of {n_all} runs are done (compiling)")
        for _, found in run_samples(task.outcome, task.model, SPREADS, factors, chunk=task.chunk, done=n_done):
            outcomes = {name: np.concatenate([outcomes[name], new]) if outcomes else new for name, new in found.items()}
            partial.keep(outcomes)
            step(f"{PartialFile.n_done(outcomes)} of {n_all} runs are done")
    return outcomes


def _central_notes(task: Task, outcomes: dict[str, np.ndarray]) -> list[str]:
    """What the first run, that of the central constants, has to say of its temperatures."""
    temperature = outcomes["focal_temperature"][0] if task.temperatures is None else task.temperatures
    ranges = central_range_notes(task.model, temperature, outcomes["lesion_length"][0])
    power = float(task.model.drive.acoustic_power)
    factors = outcomes["heating_power"][:1] / power if "heating_power" in outcomes else ()
    return [
        *boiling_notes(outcomes["boiling_time"][0]),
        *border_notes(outcomes["border_rise"][0]),
        *scaling_notes(task.settings, *map(float, factors)),
        *ranges,
    ]


def _dataset(task: Task, factors: np.ndarray, outcomes: dict[str, np.ndarray]) -> xr.Dataset:
    """What was found, and what every run gave."""
    displacement, temperatures = outcomes[task.displacement], task.temperatures
    sound = np.asarray(np.isfinite(displacement).all(axis=1))
    course = outcomes.get("thermocouple_temperature")
    if temperatures is None:
        assert course is not None  # the watched sonication gives it
        sound = sound & np.asarray(np.isfinite(course).all(axis=1))
        temperatures = np.union1d(levels_of(course, task.start), [task.reference])
        curves = curves_by_temperature(course, displacement, temperatures)
    else:
        curves = displacement
    central = [spread.central(task.model) for spread in SPREADS]
    data = analyse(temperatures, curves, task.reference, SPREADS, factors, central, sound)
    along = "curve_temperature" if course is None else "output"
    for name, values in outcomes.items():
        unit, meaning = VARIABLES.get(name, _OTHERS.get(name, ("1", "")))
        dimensions = ("sample", along)[: values.ndim]
        if name == "heating_time":  # the same in all samples
            dimensions, values = (along,), values[0]
        data[name] = (dimensions, values, {"units": unit, "long_name": meaning})
    return data


_OTHERS = {
    "heating_time": COORDINATES["heating_time"],
    "heating_power": ("W", "acoustic power with which the sonication ends at its last temperature"),
    "boiling_time": ("s", "first output time at which 100 degC are reached; NaN if never"),
    "border_rise": ("K", "largest warming of the heat grid's border, whose walls are held at the start temperature"),
}


def _write(folder: Path, data: xr.Dataset, task: Task) -> None:
    write_netcdf(data, folder / "variability.nc")
    _write_tables(folder, data)
    label = f"{task.temperature_label} [°C]"
    figures = write_figures(folder, {"bands": draw_bands(data, label), "sensitivity": draw_sensitivity(data, label)})
    (folder / "report.md").write_text(report(data, figures, task.notes), encoding="utf-8")


def _write_tables(folder: Path, data: xr.Dataset) -> None:
    curves = data[["displacement_percent", "usable"]].to_dataframe().reset_index()
    curves = curves.rename(columns={"curve_temperature": "temperature_degc"})
    curves[["sample", "temperature_degc", "displacement_percent", "usable"]].to_csv(
        folder / "curves.csv", index=False, lineterminator="\n"
    )
    quantiles = data["displacement_quantile"].to_numpy()
    names: Sequence[str] = [f"quantile_{round(100 * each):02d}_percent" for each in data["quantile"].to_numpy()]
    bands: dict[str, Any] = {"temperature_degc": data["curve_temperature"].to_numpy()}
    bands |= dict(zip(names, quantiles, strict=True))
    bands |= {name: data[name].to_numpy() for name in ("displacement_sd", "n_reaching")}
    for constant, correlation in zip(data["constant"].to_numpy(), data["rank_correlation"].to_numpy(), strict=True):
        bands[f"rank_correlation_{constant}"] = correlation
    table = np.column_stack(list(bands.values()))
    np.savetxt(folder / "bands.csv", table, fmt="%.8g", delimiter=",", header=",".join(bands), comments="")
