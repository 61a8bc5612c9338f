"""A diagnosis asked for in one call: the same as the command, in Python."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from arfjax import Experiment, InputError, read_experiment
from inverse.datasets.dma import DmaData, read_dma
from inverse.datasets.hmi import HmiData, read_hmi
from inverse.diagnosis.cause import AnyCause, Cause, DmaCause
from inverse.diagnosis.causes import DMA_CAUSES
from inverse.diagnosis.diagnosis import Diagnosis
from inverse.diagnosis.dma_diagnosis import diagnose_dma
from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.causes import HMI_CAUSES
from inverse.diagnosis.hmi.diagnosis import diagnose_hmi
from inverse.diagnosis.hmi.problem import HmiDiagnosisProblem
from inverse.diagnosis.report import as_json, report
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from inverse.figures.diagnosis import diagnosis_figure
from inverse.figures.hmi_diagnosis import hmi_diagnosis_figure
from inverse.figures.residuals import residuals_figure

MODELS = {"fractional": FRACTIONAL, "zener": CONVENTIONAL}
"""Null models by the names that users write."""


@dataclasses.dataclass(frozen=True)
class Diagnosed:
    """What a diagnosis says, and everything behind it.

    Attributes:
        content: What `diagnosis.json` holds: verdict, omnibus, causes, named, confusable, not_testable, gain, ...
        name: Of the data, for the report.
        details: Fits, statistics and noise behind it.
    """

    content: dict[str, Any]
    name: str
    details: Diagnosis

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

    def write(self, folder: Path) -> None:
        """Write `diagnosis.json`, `report.md` and the two figures (PNG and PDF) into a folder."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.content, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / "diagnosis.json").write_text(text + "\n", encoding="utf-8")
        of_hmi = isinstance(self.details.problem, HmiDiagnosisProblem)
        figure = (hmi_diagnosis_figure if of_hmi else diagnosis_figure)(self.details)
        figure.savefig(folder / "diagnosis.png", dpi=200)
        figure.savefig(folder / "diagnosis.pdf")
        left = residuals_figure(self.details)
        left.savefig(folder / "residuals.png", dpi=200)
        left.savefig(folder / "residuals.pdf")
        words = report(self.details, self.name, ["diagnosis.png", "residuals.png"])
        (folder / "report.md").write_text(words, encoding="utf-8")


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
    trust_units: bool = False,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosed:
    """Say whether the model of a measurement is wrong, by which named cause, and what mending it is worth.

    JAX has to run in double precision: `jax.config.update("jax_enable_x64", True)` first.

    Args:
        dma: CSV file of a dynamic mechanical analysis, or what `read_dma` made of one.
        hmi: CSV file of curves of displacement, or what `read_hmi` made of one; instead of `dma`.
        experiment: What those were measured in; needed for `hmi`.
        out: Folder to write `diagnosis.json`, `report.md` and the figure into; nothing is written without.
        model: Solid to examine in a DMA, fitted at each temperature: `fractional` or `zener`.
        causes: Names to look for, causes of your own, or both; the whole library without.
        level: Probability of finding fault with a right model.
        seed: Of starts and replicates.
        gain: Whether to measure what the extension gains on data left out.
        trust_units: Believe units that look wrong.
        on_step: Told what is being done.

    Raises:
        InputError: if the file, a cause or the model is not what it should be.
        ValueError: if there are too few data, `level` is out of range, or JAX runs in single precision.
    """
    if (dma is None) == (hmi is None):
        raise InputError("a diagnosis is of one measurement: give either `dma` or `hmi`, and call twice for both.")
    if hmi is not None:
        if experiment is None:
            raise InputError("curves of displacement are diagnosed in their experiment: give `experiment`.")
        described = experiment if isinstance(experiment, Experiment) else read_experiment(Path(experiment))
        curves = hmi if isinstance(hmi, HmiData) else read_hmi(Path(hmi))
        found = diagnose_hmi(
            curves, described, name="the experiment" if isinstance(experiment, Experiment) else str(experiment),
            causes=find_causes(causes or HMI_CAUSES, HMI_CAUSES), level=level, seed=seed, gain=gain, on_step=on_step,
        )  # fmt: skip
        name = "the data" if isinstance(hmi, HmiData) else Path(hmi).name
    else:
        assert dma is not None
        if model not in MODELS:
            raise InputError(f"model: there is no '{model}'; there are {', '.join(MODELS)}.")
        library = find_causes(causes or DMA_CAUSES, DMA_CAUSES)
        sweeps = dma if isinstance(dma, DmaData) else read_dma(Path(dma), trust_units=trust_units)
        found = diagnose_dma(
            sweeps, model=MODELS[model], causes=library, level=level, seed=seed, gain=gain, on_step=on_step
        )
        name = "the data" if isinstance(dma, DmaData) else Path(dma).name
    result = Diagnosed(as_json(found), name, found)
    if out is not None:
        result.write(Path(out))
    return result


def find_causes(wanted: Sequence[str | Cause], library: Sequence[AnyCause]) -> tuple[AnyCause, ...]:
    """Causes by their names; those that are causes already stay as they are, each once.

    Args:
        wanted: Names and causes.
        library: Where names are looked up.

    Raises:
        InputError: if there is none of a name, or a cause is of another kind than the library's.
    """
    known, found = {cause.name: cause for cause in library}, {}
    kind = DmaCause if isinstance(library[0], DmaCause) else HmiCause
    for one in wanted:
        if isinstance(one, str) and one not in known:
            raise InputError(f"causes: there is no cause '{one}'; there are {', '.join(known)}.")
        cause = known[one] if isinstance(one, str) else one
        if not isinstance(cause, kind):
            raise InputError(f"causes: '{cause.name}' is no {kind.__name__}: it belongs to another measurement.")
        found[cause.name] = cause
    return tuple(found.values())
