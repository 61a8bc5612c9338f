"""A diagnosis asked for in one call: the same as the command, in Python."""

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from arfjax import InputError
from inverse.datasets.dma import DmaData, read_dma
from inverse.diagnosis.cause import DmaCause
from inverse.diagnosis.causes import DMA_CAUSES
from inverse.diagnosis.diagnosis import Diagnosis, diagnose_dma
from inverse.diagnosis.report import as_json, report
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from inverse.figures.diagnosis import diagnosis_figure

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
        """Write `diagnosis.json`, `report.md` and the figure (PNG and PDF) into a folder."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.content, indent=2, ensure_ascii=False, allow_nan=False)
        (folder / "diagnosis.json").write_text(text + "\n", encoding="utf-8")
        figure = diagnosis_figure(self.details)
        figure.savefig(folder / "diagnosis.png", dpi=200)
        figure.savefig(folder / "diagnosis.pdf")
        (folder / "report.md").write_text(report(self.details, self.name, ["diagnosis.png"]), encoding="utf-8")


def diagnose(
    dma: Path | str | DmaData,
    *,
    out: Path | str | None = None,
    model: str = "fractional",
    causes: Sequence[str | DmaCause] = DMA_CAUSES,
    level: float = 0.05,
    seed: int = 0,
    gain: bool = True,
    trust_units: bool = False,
    on_step: Callable[[str], None] = lambda _: None,
) -> Diagnosed:
    """Say whether the model of a DMA measurement is wrong, by which named cause, and what mending it is worth.

    JAX has to run in double precision: `jax.config.update("jax_enable_x64", True)` first.

    Args:
        dma: CSV file, or what `read_dma` made of one.
        out: Folder to write `diagnosis.json`, `report.md` and the figure into; nothing is written without.
        model: Solid to examine, fitted at each temperature: `fractional` or `zener`.
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
    if model not in MODELS:
        raise InputError(f"model: there is no '{model}'; there are {', '.join(MODELS)}.")
    library = find_causes(causes)
    data = dma if isinstance(dma, DmaData) else read_dma(Path(dma), trust_units=trust_units)
    found = diagnose_dma(data, model=MODELS[model], causes=library, level=level, seed=seed, gain=gain, on_step=on_step)
    result = Diagnosed(as_json(found), "the data" if isinstance(dma, DmaData) else Path(dma).name, found)
    if out is not None:
        result.write(Path(out))
    return result


def find_causes(wanted: Sequence[str | DmaCause]) -> tuple[DmaCause, ...]:
    """Causes by their names; those that are causes already stay as they are, each once.

    Raises:
        InputError: if there is none of a name.
    """
    known, found = {cause.name: cause for cause in DMA_CAUSES}, {}
    for one in wanted:
        if isinstance(one, str) and one not in known:
            raise InputError(f"causes: there is no cause '{one}'; there are {', '.join(known)}.")
        cause = known[one] if isinstance(one, str) else one
        found[cause.name] = cause
    return tuple(found.values())
