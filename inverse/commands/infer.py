"""`arfjax infer`: constants with honest uncertainty, from DMA, from HMI or from both at once."""

import enum
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import jax
import typer

from arfjax import Experiment, InputError, read_experiment
from inverse.commands.console import show_lines, show_table, working
from inverse.commands.infer_report import evidence_line, parameter_rows, report, results, write_parameters
from inverse.commands.notes import grid_notes
from inverse.commands.partial import StoppedEarly
from inverse.datasets.dma import Sweep, read_dma, sweeps_of_file
from inverse.datasets.dma_checks import SWEEP_GAP
from inverse.datasets.hmi import HmiData, read_hmi
from inverse.figures.posterior import (
    Panel,
    dma_panels,
    draw_corner,
    draw_overlap,
    draw_predictions,
    draw_traces,
    hmi_panels,
)
from inverse.hmi_problem import HmiProblem, hmi_problem
from inverse.inference.dma import dma_measurement, dma_problem, of_liver
from inverse.inference.experiment import (
    DIFFERING,
    InferenceSettings,
    anchored,
    inference_problem,
    inference_settings,
)
from inverse.inference.hmi import used_rows
from inverse.inference.problem import Problem
from inverse.output import figure_files, output_directory, recorded, write_figures, write_summary
from inverse.sampling import left_out, posterior_record, save_posterior
from inverse.seeds import HIGHEST_SEED
from inverse.study import Effort, Sampler, Study, infer

_MOST_SEPARATE = 4
_MOST_STARTS_OF_HMI = 4
_FARTHEST_SWEEP_K = 10.0
"""From all temperatures of a file [K], beyond which the one asked for is a mistake, such as kelvin."""
_VERIFIED = 6
_LOOKED_AT = 200
_MOST_AT_EDGE = 0.02
_CORNER = 12
_BATCH = 16
_MADE = ["posterior.nc", *figure_files(("predictions_dma", "predictions_hmi", "overlap", "traces", "corner"))]
"""What some runs make and others do not."""


class Across(enum.StrEnum):
    """What sweeps, or curves of HMI, differ by whose constants come from one population."""

    NONE = "none"
    SAMPLE = "sample"
    TEMPERATURE = "temperature"
    SONICATION = "sonication"


def infer_command(
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    experiment: Annotated[Path | None, typer.Argument(help="Experiment file (TOML); needed for HMI.")] = None,
    dma: Annotated[
        Path | None, typer.Option(help="CSV file: frequency, temperature, storage and loss modulus.")
    ] = None,
    hmi: Annotated[Path | None, typer.Option(help="CSV file: sonication, time or temperature, displacement.")] = None,
    sampler: Annotated[
        Sampler | None, typer.Option(help="How the posterior is explored; nuts, or importance with HMI, if not given.")
    ] = None,
    temperature: Annotated[
        float | None,
        typer.Option(help="The sweep nearest to this temperature [degC]; of each sample with --across sample."),
    ] = None,
    across: Annotated[
        Across, typer.Option(help="Constants of all sweeps, or sonications, from one population.")
    ] = Across.NONE,
    varying: Annotated[
        list[str] | None, typer.Option(help="With --across sonication: a constant that differs; may be repeated.")
    ] = None,
    draws: Annotated[int, typer.Option(help="Draws of each of four chains (emcee: see --steps).", min=50)] = 1000,
    target_acceptance: Annotated[
        float | None, typer.Option(help="Of nuts, 0.8 if not given: higher against divergences.", min=0.5, max=0.999)
    ] = None,
    steps: Annotated[
        int, typer.Option(help="Steps of emcee, or evaluations of importance sampling, at most.", min=100)
    ] = 20_000,
    evidence: Annotated[bool, typer.Option("--evidence", help="Estimate the evidence, too.")] = False,
    trust_units: Annotated[bool, typer.Option("--trust-units", help="Believe units that look wrong.")] = False,
    profiles: Annotated[bool, typer.Option(help="Profile likelihoods.")] = True,
    starts: Annotated[int, typer.Option(help="Starts of the fit; four at most with HMI.", min=1)] = 16,
    seed: Annotated[int, typer.Option(help="Seed of starts and samplers.", min=0, max=HIGHEST_SEED)] = 0,
) -> None:
    """Fit, audit the fit, and sample the posterior of constants given DMA, HMI or both.

    Without an experiment, Zener constants of sweeps; with one, the constants that its section [inference] frees.
    Writes parameters.csv, posterior.nc, figures, report.md and summary.json into the folder `out`. A run that is
    stopped goes on where it was when the command is given again (nuts and emcee): its draws are in run.h5 there.
    """
    jax.config.update("jax_enable_x64", True)
    if dma is None and hmi is None:
        raise InputError("nothing to infer from: give --dma FILE, --hmi FILE or both.")
    if hmi is not None and experiment is None:
        raise InputError("HMI needs an experiment file: `arfjax infer EXPERIMENT.toml --hmi FILE --out DIR`.")
    if evidence and sampler in (Sampler.LAPLACE, Sampler.NONE):
        raise InputError("--evidence needs draws of the posterior: take --sampler nuts, emcee or importance.")
    if dma is None and (trust_units or temperature is not None):
        raise InputError("--trust-units and --temperature are of a DMA: leave them out, or give --dma FILE.")
    _check_across(across, varying, experiment, hmi)
    sampler = sampler or (Sampler.NUTS if hmi is None else Sampler.IMPORTANCE)
    if target_acceptance is not None and sampler is not Sampler.NUTS:
        raise InputError("--target-acceptance is of nuts: leave it out, or take --sampler nuts.")
    sweeps = [] if dma is None else _sweeps(dma, temperature, across, trust_units, alone=experiment is None)
    described = None if experiment is None else _described(experiment, across, varying or [])
    curves = None if hmi is None else read_hmi(hmi)
    inputs = recorded({"experiment": experiment, "dma": dma, "hmi": hmi})
    starts = starts if hmi is None else min(starts, _MOST_STARTS_OF_HMI)
    effort = Effort(
        starts=starts,
        most_starts=None if hmi is None else _MOST_STARTS_OF_HMI,
        draws=draws,
        target_acceptance=target_acceptance or Effort.target_acceptance,
        most_steps=steps,
        most_evaluations=steps,
        with_profiles=profiles,
        chunk=None if hmi is None else _BATCH,
    )
    # Before anything is computed: a folder that cannot be written to is told at once.
    with working("reading") as say, output_directory(out, replaces=_MADE) as folder:
        problem, panels, made = _problem(described, sweeps, curves, across, seed, say)
        file = out / "run.h5" if sampler in (Sampler.NUTS, Sampler.EMCEE) else None
        try:
            study = infer(problem, sampler=sampler, seed=seed, effort=effort, evidence=evidence, file=file, on_step=say)
        except KeyboardInterrupt:
            if file is None or not file.exists():
                raise
            raise StoppedEarly(f"draws so far are kept in {file}; the same command goes on from there.") from None
        checked, remark = None, "" if made is None else made.remark
        if made is not None and study.draws is not None:
            checked = made.verify(study.draws.spread_evenly(_VERIFIED), on_step=say)
            remark = " ".join(each for each in (remark, _cut_off(made, study)) if each)
        say("figures")
        figures, note = _write_posterior(folder, study, panels, seed)
        not_used = [*(sweeps[0].data.remarks if sweeps else ()), *(curves.remarks if curves else ())]
        if curves is not None and described is not None:
            not_used += grid_notes(described[0].model())
        remark = " ".join(each for each in (remark, note, *not_used) if each)
        write_parameters(folder / "parameters.csv", study)
        labels = [sweep.label for sweep in sweeps]
        given = [path for path in (experiment, dma, hmi) if path is not None]
        (folder / "report.md").write_text(report(study, given, labels, figures, checked, remark), encoding="utf-8")
        write_summary(
            folder,
            command="infer",
            inputs=inputs,
            seed=seed,
            settings={
                "sampler": sampler.value,
                "temperature": temperature,
                "sweeps": labels,
                "across": across.value,
                "varying": varying or [],
                "draws": draws,
                "target_acceptance": target_acceptance,
                "steps": steps,
                "evidence": evidence,
                "profiles": profiles,
                "trust_units": trust_units,
                "starts": starts,
            },
            results=results(study, checked, remark),
        )
    _show(study, remark, out)


def _check_across(across: Across, varying: list[str] | None, experiment: Path | None, hmi: Path | None) -> None:
    """Refuse populations of what there is none of."""
    if varying and across is not Across.SONICATION:
        raise InputError("--varying names what differs between sonications: give --across sonication, too.")
    if across is Across.SONICATION and hmi is None:
        raise InputError("--across sonication needs the sonications of an HMI file: give --hmi FILE, or leave it out.")
    if experiment is not None and across in (Across.SAMPLE, Across.TEMPERATURE):
        raise InputError(
            "--across sample or temperature goes with sweeps alone: with an experiment all sweeps are of the one liver "
            "in it. Leave out the experiment, choose a sweep by --temperature, or take --across sonication."
        )


def _sweeps(path: Path, temperature: float | None, across: Across, trust_units: bool, *, alone: bool) -> list[Sweep]:
    sweeps = list(sweeps_of_file(path, read_dma(path, trust_units=trust_units)))
    if temperature is not None:
        sweeps = _nearest(path, sweeps, temperature, each_sample=across is Across.SAMPLE)
    if across in (Across.SAMPLE, Across.TEMPERATURE):
        _require_population(path, sweeps, across)
    if alone and across is Across.NONE and len(sweeps) > _MOST_SEPARATE:
        raise InputError(
            f"{path}: holds {len(sweeps)} sweeps; choose one by --temperature, or let their constants come from one "
            "population by --across sample or --across temperature."
        )
    short = [sweep for sweep in sweeps if sweep.data.distinct_frequencies < 2]
    if alone and short:
        raise InputError(f"{path}: the sweep at {short[0].label} has a single frequency, which fixes no constants.")
    return sweeps


def _require_population(path: Path, sweeps: list[Sweep], across: Across) -> None:
    """Refuse sweeps that are one, that do not differ by what is named, or of which some are alike in it."""
    if len(sweeps) < 2:
        raise InputError(
            f"--across {across.value}: a population needs two sweeps or more, here is one ({sweeps[0].label}); leave "
            "--across or --temperature out."
        )
    if across is Across.SAMPLE and len({sweep.sample for sweep in sweeps}) < 2:
        raise InputError(
            f"--across sample: the sweeps of {path} are of one sample; name samples in a column 'sample', or take "
            "--across temperature."
        )
    if across is Across.SAMPLE:
        pairs = itertools.pairwise(sorted(sweeps, key=lambda sweep: sweep.sample))
        alike = [pair for pair in pairs if pair[0].sample == pair[1].sample]
        mend = "choose one sweep of each sample by --temperature"
    else:
        pairs = itertools.pairwise(sorted(sweeps, key=lambda sweep: sweep.temperature_c))
        alike = [pair for pair in pairs if pair[1].temperature_c - pair[0].temperature_c <= SWEEP_GAP]
        mend = "take --across sample, or give a file of one sample"
    if alike:
        one, other = alike[0]
        raise InputError(
            f"--across {across.value}: the sweeps of {path} at {one.label} and {other.label} do not differ by "
            f"{across.value}; {mend}."
        )


def _nearest(path: Path, sweeps: list[Sweep], temperature: float, *, each_sample: bool) -> list[Sweep]:
    """The sweep nearest to a temperature, or that of each sample."""
    coldest, hottest = (limit(sweep.temperature_c for sweep in sweeps) for limit in (min, max))
    if not coldest - _FARTHEST_SWEEP_K <= temperature <= hottest + _FARTHEST_SWEEP_K:
        raise InputError(
            f"--temperature {temperature:g}: sweeps of {path} are at {coldest:.1f} to {hottest:.1f} degC; give one of "
            "their temperatures in degC."
        )
    samples = dict.fromkeys(sweep.sample for sweep in sweeps)
    parts = [[s for s in sweeps if s.sample == sample] for sample in samples] if each_sample else [sweeps]
    nearest = [min(part, key=lambda sweep: abs(sweep.temperature_c - temperature)) for part in parts]
    for sweep in nearest if each_sample else ():
        if abs(sweep.temperature_c - temperature) > _FARTHEST_SWEEP_K:
            raise InputError(
                f"--temperature {temperature:g}: the nearest sweep of sample {sweep.sample} in {path} is at "
                f"{sweep.temperature_c:.1f} degC, and what temperature does would count as a difference of samples; "
                "choose a temperature near one of every sample's, or leave its rows out."
            )
    return nearest


def _described(path: Path, across: Across, varying: list[str]) -> tuple[Experiment, InferenceSettings]:
    """The experiment, and what it and the command line say of the inference."""
    described = read_experiment(path)
    settings = inference_settings(described, str(path))
    if across is Across.SONICATION:
        names = tuple(varying) or settings.across_sonications or DIFFERING
        settings = settings.model_copy(update={"across_sonications": names})
    return described, settings


def _problem(
    experiment: tuple[Experiment, InferenceSettings] | None,
    sweeps: list[Sweep],
    curves: HmiData | None,
    across: Across,
    seed: int,
    say: Callable[[str], None],
) -> tuple[Problem, dict[str, list[Panel]], HmiProblem | None]:
    """What is inferred, how it is drawn, and the fast model if there is one."""
    panels = {"dma": dma_panels(sweeps)} if sweeps else {}
    if experiment is None:
        population = None if across is Across.NONE else across.value
        return dma_problem(sweeps, across=population), panels, None
    described, settings = experiment
    measurements = [dma_measurement(sweeps, of_liver)] if sweeps else []
    if curves is None:
        model = anchored(described.model(), settings)
        alone = settings.model_copy(update={"across_sonications": ()})
        return inference_problem(alone, model, tuple(measurements)), panels, None
    say("fast model: drawing models to learn from")
    made = hmi_problem(described, settings, curves, measurements, seed=seed, on_step=say)
    panels["hmi"] = hmi_panels(curves, used_rows(curves, settings.reference_temperature_c))
    return made.problem, panels, made


def _cut_off(made: HmiProblem, study: Study) -> str:
    """A sentence if the posterior reaches the edge of what the fast model covers."""
    assert study.draws is not None
    share = made.near_edge(study.draws.spread_evenly(_LOOKED_AT))
    if share <= _MOST_AT_EDGE:
        return ""
    return (
        f"{100.0 * share:.2g} % of the draws lie at the edge of what the fast model covers, beyond which there is no "
        "density: the posterior is cut off there. Narrow the priors, or fit with fewer constants."
    )


def _write_posterior(folder: Path, study: Study, panels: dict[str, list[Panel]], seed: int) -> tuple[list[str], str]:
    """Names of the figures, and what must be known of the record."""
    if study.draws is None:
        return [], ""
    record = posterior_record(study.problem, study.draws, seed=seed)
    save_posterior(record, folder / "posterior.nc")
    drawn = {f"predictions_{name}": draw_predictions(record, name, list(each)) for name, each in panels.items()}
    drawn |= {"overlap": draw_overlap(record), "traces": draw_traces(record)}
    if len(study.problem.parameters.columns) <= _CORNER:
        drawn["corner"] = draw_corner(record)
    return write_figures(folder, drawn), left_out(record)


def _show(study: Study, remark: str, out: Path) -> None:
    header, rows = parameter_rows(study)
    show_table("constants", header, rows, left=2)
    weighed = [] if study.evidence is None else [evidence_line(study.evidence)]
    show_lines([*weighed, *study.warnings, *([remark] if remark else []), f"written to {out}"])
