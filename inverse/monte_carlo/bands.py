"""What many curves say together: bands, which constant they follow, and where they are highest."""

from collections.abc import Sequence

import numpy as np
import scipy.stats
import xarray as xr
from jaxtyping import Bool, Float, Int

from arfjax import InputError
from inverse.monte_carlo.spreads import Spread

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Of the bands: median, the middle half, the middle nine tenths."""

FEWEST_REACHING = 0.5
"""Share of the samples that must reach a temperature for it to be among those of the curves."""
_BY_CHANCE = 0.05

UNITS = {
    "displacement_percent": ("percent", "displacement normalised to the reference temperature"),
    "central_displacement_percent": ("percent", "the same with the model's own constants"),
    "displacement_quantile": ("percent", "quantile over the samples that reach the temperature"),
    "displacement_sd": ("percent", "standard deviation over the samples that reach the temperature"),
    "n_reaching": ("1", "usable samples that reach the temperature"),
    "rank_correlation": ("1", "Spearman's rank correlation of the displacement with each constant's draws"),
    "rank_correlation_by_chance": ("1", "that the largest of all constants' exceeds by chance once in twenty times"),
    "highest_at": ("degC", "temperature at which the displacement is highest"),
    "usable": ("1", "1 where every value of the sample is finite and its reference temperature is reached"),
    "factor": ("1", "drawn factor on the model's own value"),
    "drawn_value": ("", "drawn value, in constant_unit"),
    "central_value": ("", "the model's own value, in constant_unit"),
    "relative_sd": ("1", "standard deviation over mean of the distribution"),
}
"""Unit and meaning of what is found here."""


def curves_by_temperature(
    course: Float[np.ndarray, "sample time"],
    displacement: Float[np.ndarray, "sample time"],
    levels: Float[np.ndarray, " level"],
) -> Float[np.ndarray, "sample level"]:
    """Displacement when a course of temperature [degC] first reaches each level; NaN where it never does."""
    rows = []
    for shown, values in zip(course, displacement, strict=True):
        reached = shown[None, :] >= levels[:, None]
        after = reached.argmax(axis=1)
        before = np.maximum(after - 1, 0)
        rise = np.where(after > 0, shown[after] - shown[before], 1.0)
        weight = np.where(after > 0, (levels - shown[before]) / rise, 0.0)
        between = values[before] + weight * (values[after] - values[before])
        rows.append(np.where(reached.any(axis=1), between, np.nan))
    return np.stack(rows)


def levels_of(course: Float[np.ndarray, "sample time"], start: float, *, step: float = 1.0) -> np.ndarray:
    """Temperatures [degC] from the start, in steps, up to what half of the samples reach."""
    finite = course[np.isfinite(course).all(axis=1)]
    top = start if len(finite) == 0 else float(np.quantile(finite.max(axis=1), 1.0 - FEWEST_REACHING))
    return start + step * np.arange(max(int((top - start) / step), 0) + 1)


def analyse(
    temperature: Float[np.ndarray, " at"],
    displacement: Float[np.ndarray, "sample at"],
    reference: float,
    spreads: Sequence[Spread],
    factors: Float[np.ndarray, "sample constant"],
    central: Sequence[float],
    sound: Bool[np.ndarray, " sample"],
) -> xr.Dataset:
    """Curves, bands, correlations and highest points as one data set.

    Args:
        temperature: Of the curves [degC], rising, the reference among them.
        displacement: Of every sample at these temperatures [m], the first with the central constants; NaN where a
            sample does not reach a temperature.
        reference: Temperature of 100 percent [degC].
        spreads: Of the constants that vary.
        factors: Drawn, all one for the first sample.
        central: Central value of each constant.
        sound: Whether a sample's run gave finite numbers. Others are kept and counted, and take part in nothing.

    Raises:
        InputError: if fewer than two drawn samples are usable.
    """
    at_reference = displacement[:, [int(np.argmin(np.abs(temperature - reference)))]]
    usable = sound & np.isfinite(at_reference[:, 0])
    if usable[1:].sum() < 2:
        raise InputError(
            f"only {int(usable[1:].sum())} of {len(usable) - 1} samples gave finite displacement and reached the "
            f"{reference:g} degC of 100 percent; check the file's laws and powers, or narrow the spreads."
        )
    percent = 100.0 * displacement / at_reference
    drawn = np.where(usable[1:, None], percent[1:], np.nan)
    names = np.array([each.name for each in spreads], dtype=object)
    n_reaching = np.isfinite(drawn).sum(axis=0)
    values = {
        "displacement_percent": (("sample", "curve_temperature"), percent),
        "central_displacement_percent": (("curve_temperature",), percent[0]),
        "displacement_quantile": (("quantile", "curve_temperature"), _quantiles(drawn)),
        "displacement_sd": (("curve_temperature",), _standard_deviation(drawn)),
        "n_reaching": (("curve_temperature",), n_reaching),
        "rank_correlation": (("constant", "curve_temperature"), rank_correlations(factors[1:], drawn)),
        "rank_correlation_by_chance": (("curve_temperature",), correlation_noise(n_reaching, len(spreads))),
        "highest_at": (("sample",), np.array([highest_at(temperature, row) for row in percent])),
        "usable": (("sample",), usable.astype(np.int8)),
        "factor": (("sample", "constant"), factors),
        "drawn_value": (("sample", "constant"), factors * np.asarray(central)),
        "central_value": (("constant",), np.asarray(central)),
        "relative_sd": (("constant",), np.array([each.relative_sd for each in spreads])),
    }
    data = xr.Dataset(
        values,
        {
            "sample": ("sample", np.arange(len(factors)), {"long_name": "0 has the model's own constants"}),
            "curve_temperature": ("curve_temperature", temperature, {"units": "degC"}),
            "quantile": ("quantile", np.array(QUANTILES), {"units": "1"}),
            "constant": ("constant", names),
        },
        {"reference_temperature_degc": reference},
    )
    for name in values:
        unit, meaning = UNITS[name]
        data[name].attrs = {"long_name": meaning} | ({"units": unit} if unit else {})
    texts = {"constant_unit": "unit", "constant_label": "label", "distribution": "distribution", "source": "source"}
    for name, field in texts.items():
        data[name] = ("constant", np.array([getattr(each, field) for each in spreads], dtype=object))
    data["measured"] = ("constant", np.array([each.measured for each in spreads], dtype=np.int8))
    data["measured"].attrs["long_name"] = "1 where the spread is measured, 0 where it is assumed"
    return data


def highest_at(temperature: Float[np.ndarray, " at"], displacement: Float[np.ndarray, " at"]) -> float:
    """Temperature [degC] of the highest displacement, on the parabola through it and its neighbours; NaN if none."""
    if not np.isfinite(displacement).any():
        return np.nan
    top = int(np.nanargmax(displacement))
    if not 0 < top < len(temperature) - 1 or not np.isfinite(displacement[top + 1]):
        return float(temperature[top])
    around = slice(top - 1, top + 2)
    curvature, slope, _ = np.polyfit(temperature[around] - temperature[top], displacement[around], 2)
    return float(temperature[top] - 0.5 * slope / curvature) if curvature < 0.0 else float(temperature[top])


def rank_correlations(
    factors: Float[np.ndarray, "sample constant"], values: Float[np.ndarray, "sample at"]
) -> Float[np.ndarray, "constant at"]:
    """Spearman's rank correlation of every constant with the value at every place, over the samples that have one.

    NaN where either does not vary, such as at the temperature of normalisation.
    """
    result = np.full((factors.shape[1], values.shape[1]), np.nan)
    for place, column in enumerate(values.T):
        there = np.isfinite(column)
        if there.sum() < 3 or not _varies(column[there]):
            continue
        for constant, drawn in enumerate(factors.T):
            if _varies(drawn[there]):
                ranks = scipy.stats.rankdata([drawn[there], column[there]], axis=1)
                result[constant, place] = np.corrcoef(ranks)[0, 1]
    return result


def correlation_noise(n_samples: Int[np.ndarray, " at"], among: int) -> Float[np.ndarray, " at"]:
    """Rank correlation that the largest of so many exceeds by chance alone once in twenty times.

    Args:
        n_samples: That it is computed from.
        among: Constants, of which the largest is looked at.
    """
    each = 1.0 - (1.0 - _BY_CHANCE) ** (1.0 / among)
    return scipy.stats.norm.isf(0.5 * each) / np.sqrt(np.maximum(n_samples - 1, 1))


def _varies(values: np.ndarray) -> bool:
    return bool(np.ptp(values) > 1e-12 * np.abs(values).max())


def _quantiles(drawn: Float[np.ndarray, "sample at"]) -> np.ndarray:
    result = np.full((len(QUANTILES), drawn.shape[1]), np.nan)
    some = np.isfinite(drawn).any(axis=0)
    result[:, some] = np.nanquantile(drawn[:, some], QUANTILES, axis=0)
    return result


def _standard_deviation(drawn: Float[np.ndarray, "sample at"]) -> np.ndarray:
    result = np.full(drawn.shape[1], np.nan)
    enough = np.isfinite(drawn).sum(axis=0) > 1
    result[enough] = np.nanstd(drawn[:, enough], axis=0, ddof=1)
    return result
