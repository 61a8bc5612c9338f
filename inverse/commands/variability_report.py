"""What `arfjax vary` says about its samples: tables, summary and report."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from inverse.monte_carlo.spreads import FIXED
from inverse.output import quantity

HEADER = ("temperature [degC]", "samples", "median [%]", "50 % [%]", "90 % [%]", "follows most")
_EVERY_K = 5.0


def rows(data: xr.Dataset) -> list[tuple[str, ...]]:
    """Bands about every fifth degree: temperature, samples, median, bands and the constant that is followed most."""
    table = []
    for index in _listed(data["curve_temperature"].to_numpy()):
        at = float(data["curve_temperature"][index])
        low, lower, median, upper, high = data["displacement_quantile"].to_numpy()[:, index]
        table.append(
            (
                f"{at:g}",
                f"{int(data['n_reaching'][index])}",
                f"{median:.1f}",
                f"{lower:.1f} to {upper:.1f}",
                f"{low:.1f} to {high:.1f}",
                _followed(data, index),
            )
        )
    return table


def _listed(temperature: np.ndarray) -> list[int]:
    """The first and the last of ascending temperatures, and between them the nearest to every fifth degree."""
    first, last = float(temperature[0]), float(temperature[-1])
    fifths = _EVERY_K * np.arange(np.ceil(first / _EVERY_K), np.floor(last / _EVERY_K) + 1.0)
    nearest = (int(np.argmin(np.abs(temperature - at))) for at in fifths)
    return sorted({0, len(temperature) - 1, *nearest})


def _followed(data: xr.Dataset, index: int) -> str:
    correlation = data["rank_correlation"].to_numpy()[:, index]
    if not np.isfinite(correlation).any():
        return "-"
    most = int(np.nanargmax(np.abs(correlation)))
    return f"{data['constant_label'].to_numpy()[most]} ({correlation[most]:+.2f})"


def results(data: xr.Dataset) -> dict[str, Any]:
    """Counts, bands, correlations and spreads for summary.json."""
    highest = _highest(data)
    quantiles = data["displacement_quantile"].to_numpy()
    return {
        "n_samples": data.sizes["sample"] - 1,
        "n_usable": int(_usable(data).sum()),
        "unusable_samples": _unusable(data),
        "temperature": {"value": data["curve_temperature"].to_numpy().tolist(), "unit": "degC"},
        "n_reaching": data["n_reaching"].to_numpy().tolist(),
        "displacement_quantiles": {
            f"{level:g}": {"value": values.tolist(), "unit": "percent"}
            for level, values in zip(data["quantile"].to_numpy(), quantiles, strict=True)
        },
        "central_displacement": {"value": data["central_displacement_percent"].to_numpy().tolist(), "unit": "percent"},
        "displacement_sd": {"value": data["displacement_sd"].to_numpy().tolist(), "unit": "percent"},
        "temperature_of_highest_displacement": {
            name: quantity(value, "degC")
            for name, value in zip(
                ("q05", "median", "q95"), np.quantile(highest, (0.05, 0.5, 0.95)).tolist(), strict=True
            )
        },
        "rank_correlation": {
            str(name): values.tolist()
            for name, values in zip(data["constant"].to_numpy(), data["rank_correlation"].to_numpy(), strict=True)
        },
        "rank_correlation_by_chance": data["rank_correlation_by_chance"].to_numpy().tolist(),
        "spreads": {
            str(name): {
                "central": quantity(float(data["central_value"][index]), str(data["constant_unit"].to_numpy()[index])),
                "relative_sd": float(data["relative_sd"][index]),
                "distribution": str(data["distribution"].to_numpy()[index]),
                "measured": bool(data["measured"][index]),
                "source": str(data["source"].to_numpy()[index]),
            }
            for index, name in enumerate(data["constant"].to_numpy())
        },
        "fixed": list(FIXED),
    }


def report(data: xr.Dataset, figures: Sequence[str], notes: Sequence[str]) -> str:
    """The report in Markdown."""
    n_samples, n_usable = data.sizes["sample"] - 1, int(_usable(data).sum())
    low, median, high = np.quantile(_highest(data), (0.05, 0.5, 0.95))
    lines = [
        f"# {data.attrs['title']}: how far it varies with tissue",
        "",
        f"The {data.attrs['protocol']} protocol in {n_samples} tissues, drawn by {data.attrs['sampling']} sampling "
        f"with seed {data.attrs['seed']}; displacement in percent of that at "
        f"{data.attrs['reference_temperature_degc']:g} degC; temperature is the {data.attrs['temperature']}.",
        "",
        f"Displacement is highest at {median:.1f} degC ({low:.1f} to {high:.1f} in 90 % of samples; "
        f"{_own_highest(data)}), on the parabola through the highest "
        "value and its neighbours in the table of the curve.",
        "",
        "| " + " | ".join(HEADER) + " |",
        "|" + " ---: |" * 5 + " --- |",
        *("| " + " | ".join(row) + " |" for row in rows(data)),
        "",
        *_reservations(data, n_samples, n_usable),
        *(f"- {note}" for note in notes),
        "",
        "## What varies",
        "",
        "| constant | the model's value | relative sd | distribution | spread is | source |",
        "| --- | ---: | ---: | --- | --- | --- |",
        *_spread_rows(data),
        "",
        "Of the sources only the relative spread is used, around the model's own values, and all constants vary "
        "independently of each other.",
        "",
        "## What does not vary",
        "",
        "No measured spread of it is at hand, or it is not tissue:",
        "",
        *(f"- {each}" for each in FIXED),
        "",
        *(f"![{name}]({name})" for name in figures),
    ]
    return "\n".join(lines) + "\n"


def _reservations(data: xr.Dataset, n_samples: int, n_usable: int) -> list[str]:
    noise = data["rank_correlation_by_chance"].to_numpy()
    most = f"{noise.min():.2f}" if noise.max() < noise.min() + 0.005 else f"{noise.min():.2f} to {noise.max():.2f}"
    notes = [
        f"- {n_usable} of {n_samples} samples are usable."
        if n_usable == n_samples
        else f"- ONLY {n_usable} of {n_samples} samples are usable; the others gave no finite displacement or never "
        f"reached the temperature of 100 %, and are left out of all bands: samples "
        f"{', '.join(map(str, _unusable(data)))}.",
        f"- Correlations are rank correlations (Spearman). Of constants that do nothing the largest lies below {most} "
        "nineteen times in twenty (the higher, the fewer samples reach a temperature).",
    ]
    if not _own_is_usable(data):
        notes.append(
            "- THE RUN WITH THE MODEL'S OWN CONSTANTS GAVE NO FINITE DISPLACEMENT OR NEVER REACHED THE TEMPERATURE OF "
            "100 %: there is no curve of it."
        )
    if int(data["n_reaching"].min()) < n_usable:
        notes.append(
            "- Not every sample reaches the highest temperatures. Bands there are those of the samples that do, as "
            "counted in the table."
        )
    boiling = data.get("boiling_time")
    if boiling is not None and (n_boiling := int(np.isfinite(boiling.to_numpy()[1:]).sum())):
        notes.append(
            f"- Tissue reaches 100 degC in {n_boiling} samples: it would boil, which is not simulated; what they show "
            "after that is not to be trusted."
        )
    return notes


def _spread_rows(data: xr.Dataset) -> list[str]:
    columns = ("constant_label", "constant_unit", "distribution", "source")
    labels, units, distributions, sources = (data[name].to_numpy() for name in columns)
    return [
        f"| {labels[index]} | {float(data['central_value'][index]):.4g} {units[index]} | "
        f"{100.0 * float(data['relative_sd'][index]):.1f} % | {distributions[index]} | "
        f"{'measured' if bool(data['measured'][index]) else 'assumed'} | {sources[index]} |"
        for index in range(len(labels))
    ]


def _unusable(data: xr.Dataset) -> list[int]:
    """Numbers of the samples drawn that take part in nothing."""
    return (1 + np.flatnonzero(~_usable(data))).tolist()


def _own_is_usable(data: xr.Dataset) -> bool:
    return bool(data["usable"][0] == 1)


def _own_highest(data: xr.Dataset) -> str:
    own = f"{float(data['highest_at'][0]):.1f}" if _own_is_usable(data) else "unknown"
    return f"{own} with the model's own constants"


def _usable(data: xr.Dataset) -> np.ndarray:
    return data["usable"].to_numpy()[1:] == 1


def _highest(data: xr.Dataset) -> np.ndarray:
    return data["highest_at"].to_numpy()[1:][_usable(data)]
