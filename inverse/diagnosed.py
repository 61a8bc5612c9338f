"""A diagnosis asked for in one call: the same as the command, in Python."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from arfjax import Experiment, InputError, read_experiment
from inverse.datasets.dma import DmaData, read_dma, require_loss
from inverse.datasets.hmi import HmiData, read_hmi
from inverse.design import Design, design_dma, design_hmi
from inverse.design.report import in_short, in_words
from inverse.diagnosis.cause import Cause
from inverse.diagnosis.choice import find_causes
from inverse.diagnosis.content import as_json
from inverse.diagnosis.diagnosis import Diagnosis
from inverse.diagnosis.dma.causes import DMA_CAUSES
from inverse.diagnosis.dma.diagnosis import diagnose_dma
from inverse.diagnosis.hmi.causes import HMI_CAUSES
from inverse.diagnosis.hmi.diagnosis import diagnose_hmi, require_diagnosable
from inverse.diagnosis.hmi.prepare import LEARNT, prepare_hmi
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.level import require_level
from inverse.diagnosis.report import report
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL, ZenerModel
from inverse.figures.diagnosis import diagnosis_figure
from inverse.figures.hmi_diagnosis import hmi_diagnosis_figure
from inverse.figures.residuals import residuals_figure
from inverse.output import figure_files, output_directory, write_figures, write_json
from inverse.precision import require_double_precision
from inverse.resolution import diagnosed_as_measured
from inverse.seeds import HIGHEST_SEED

MODELS = {"fractional": FRACTIONAL, "zener": CONVENTIONAL}
"""Null models by the names that users write."""
CONTENT, _REPORT, _FIGURES = "diagnosis.json", "report.md", ("diagnosis", "residuals")
FILES = (CONTENT, _REPORT, *figure_files(_FIGURES))
"""That a diagnosis is written to."""


@dataclasses.dataclass(frozen=True)
class Diagnosed:
    """What a diagnosis says, and everything behind it.

    Attributes:
        content: What `diagnosis.json` holds: verdict, omnibus, causes, named, confusable, separation, not_testable, ...
        name: Of the data, for the report.
        details: Fits, statistics and noise behind it.
        design: What would separate causes that these data cannot tell apart; None if there are none, if they come in
            pairs, if not asked for, or if nothing can be designed (`remarks` say why).
        remarks: On the file, such as columns that were not used, or that its numbers look simulated.
    """

    content: dict[str, Any]
    name: str
    details: Diagnosis
    design: Design | None
    remarks: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """`adequate`, `named`, `confusable`, `unexplained`, `noise-model` or `fit-failure`."""
        return self.details.verdict

    @property
    def named(self) -> tuple[str, ...]:
        """Causes that are named."""
        return self.details.named

    @property
    def confusable(self) -> tuple[tuple[str, ...], ...]:
        """Sets of causes that these data cannot tell apart."""
        return self.details.confusable

    def noting(self, remarks: Sequence[str]) -> "Diagnosed":
        """The same with more remarks, on what is not of the file."""
        content = {**self.content, "notes": [*remarks, *self.content["notes"]]}
        return dataclasses.replace(self, content=content, remarks=(*self.remarks, *remarks))

    def write(self, folder: Path) -> None:
        """Write `diagnosis.json`, `report.md` and two figures (PNG and PDF) into a folder: all of them, or none."""
        with output_directory(folder) as whole:
            write_json(whole / CONTENT, self.content)
            of_hmi = isinstance(self.details.problem, HmiDiagnosisProblem)
            figure = (hmi_diagnosis_figure if of_hmi else diagnosis_figure)(self.details)
            figures = (figure, residuals_figure(self.details))
            names = write_figures(whole, dict(zip(_FIGURES, figures, strict=True)))
            apart = in_words(self.design) if self.design else []
            words = report(self.details, self.name, names, apart=apart, remarks=self.remarks)
            (whole / _REPORT).write_text(words, encoding="utf-8")


def diagnose(
    dma: Path | str | DmaData | None = None,
    *,
    hmi: Path | str | HmiData | None = None,
    experiment: Path | str | Experiment | None = None,
    out: Path | str | None = None,
    model: str = "fractional",
    causes: Sequence[str | Cause] = (),
    level: float = 0.05,
    seed: int = 0,
    gain: bool = True,
    separate: bool = True,
    trust_units: bool = False,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosed:
    """Say whether the model of a measurement is wrong, by which named cause, and what mending it is worth.

    JAX has to run in double precision: `jax.config.update("jax_enable_x64", True)` first.

    Args:
        dma: CSV file of a dynamic mechanical analysis, or what `read_dma` made of one.
        hmi: CSV file of curves of displacement, or what `read_hmi` made of one; instead of `dma`.
        experiment: What those were measured in; needed for `hmi`.
        out: Folder to write `diagnosis.json`, `report.md` and two figures into; nothing is written without.
        model: Solid to examine in a DMA, fitted at each temperature: `fractional` or `zener`.
        causes: Names to look for, causes of your own, or both; the whole library without.
        level: Probability of finding fault with a right model.
        seed: Of starts and replicates.
        gain: Whether to measure what the extension gains on data left out.
        separate: Whether to look for the measurement that would separate causes that these data cannot tell apart, if
            each explains them alone.
        trust_units: Believe units that look wrong.
        on_step: Told what is being done.

    Raises:
        InputError: if the file, a cause, the model, `level`, `seed` or `out` is not what it should be, or data are too
            few.
        ValueError: if JAX runs in single precision.
    """
    if (dma is None) == (hmi is None):
        raise InputError("a diagnosis is of one measurement: give either `dma` or `hmi`, and call twice for both.")
    if hmi is not None and (model != "fractional" or trust_units):
        raise InputError(
            "`model` and `trust_units` are of a DMA: curves of displacement are of the experiment's solid."
        )
    if dma is not None and experiment is not None:
        raise InputError("a DMA is diagnosed without an experiment: leave out `experiment`.")
    if isinstance(causes, str):
        raise InputError(f"`causes` must be a list of names, got a text: write ['{causes}'].")
    if not isinstance(causes, Sequence):
        raise InputError(f"`causes` must be a list, got {type(causes).__name__}: write [...] around it.")
    if not 0 <= seed <= HIGHEST_SEED:
        raise InputError(f"`seed` must be 0 to {HIGHEST_SEED}, got {seed}.")
    require_level(level)
    require_double_precision("diagnoses")
    asked = _Asked(causes, level, seed, gain, separate, on_step)
    with nullcontext() if out is None else output_directory(Path(out)) as folder:
        if hmi is not None:
            result = _of_hmi(hmi, experiment, asked)
        else:
            assert dma is not None
            if model not in MODELS:
                raise InputError(f"model: there is no '{model}'; there are {', '.join(MODELS)}.")
            sweeps = dma if isinstance(dma, DmaData) else read_dma(Path(dma), trust_units=trust_units)
            name = "the data" if isinstance(dma, DmaData) else Path(dma).name
            result = _of_dma(sweeps, name, MODELS[model], asked)
        if folder is not None:
            result.write(folder)
    return result


@dataclasses.dataclass(frozen=True)
class _Asked:
    """What `diagnose` was asked for, whatever was measured."""

    causes: Sequence[str | Cause]
    level: float
    seed: int
    gain: bool
    separate: bool
    on_step: Callable[[str], None]

    def answered(
        self, found: Diagnosis, name: str, remarks: tuple[str, ...], design: Callable[[Sequence[str]], Design]
    ) -> Diagnosed:
        """The answer, with what would separate causes that the data cannot tell apart."""
        apart = next(iter(found.confusable), ())
        # Of causes that stand for one another; of pairs, those of one pair do not.
        single = found.decision is not None and all(len(names) == 1 for names in found.decision.explanations)
        designed = None
        if self.separate and single and len(apart) > 1:
            try:
                designed = design(apart)
            except InputError as error:  # of further readings beside these: what these say stands
                remarks = (*remarks, f"Which measurement would tell them apart is not known: {error}")
        separation = [] if designed is None else [in_short(designed)]
        content = {**as_json(found, remarks), "separation": separation}
        return Diagnosed(content, name, found, designed, remarks)


def _of_dma(data: DmaData, name: str, model: ZenerModel, asked: _Asked) -> Diagnosed:
    data = data.without_copies()
    require_loss(data, name)
    causes = find_causes(asked.causes or DMA_CAUSES, DMA_CAUSES)
    diagnosis = functools.partial(
        diagnose_dma, model=model, causes=causes, level=asked.level, seed=asked.seed, gain=asked.gain,
        on_step=asked.on_step,
    )  # fmt: skip
    examined, found, further = diagnosed_as_measured(data, diagnosis, asked.seed)

    def design(names: Sequence[str]) -> Design:
        return design_dma(
            examined, found=found, causes=names, model=model, library=causes, check=False, locate=False,
            seed=asked.seed, on_step=asked.on_step,
        )  # fmt: skip

    return asked.answered(found, name, (*data.remarks, *further), design)


def _of_hmi(hmi: Path | str | HmiData, experiment: Path | str | Experiment | None, asked: _Asked) -> Diagnosed:
    if experiment is None:
        raise InputError("curves of displacement are diagnosed in their experiment: give `experiment`.")
    described = experiment if isinstance(experiment, Experiment) else read_experiment(Path(experiment))
    place = "the experiment" if isinstance(experiment, Experiment) else str(experiment)
    data, name = (hmi, "the data") if isinstance(hmi, HmiData) else (read_hmi(Path(hmi)), Path(hmi).name)
    data = data.without_copies()
    causes, settings = find_causes(asked.causes or HMI_CAUSES, HMI_CAUSES), require_diagnosable(data, described, place)
    prepared = prepare_hmi(described, settings, data, seed=asked.seed, effort=LEARNT, on_step=asked.on_step)
    found = diagnose_hmi(
        data, described, name=place, causes=causes, level=asked.level, seed=asked.seed, gain=asked.gain,
        prepared=prepared, on_step=asked.on_step,
    )  # fmt: skip

    def design(names: Sequence[str]) -> Design:
        return design_hmi(
            data, described, name=place, found=found, prepared=prepared, causes=names, library=causes, check=False,
            seed=asked.seed, on_step=asked.on_step,
        )  # fmt: skip

    return asked.answered(found, name, data.remarks, design)
