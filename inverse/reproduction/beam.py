"""How large the force field is beside the lesion, which the paper calls larger at 65 degC."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from arfjax import suomi2016
from inverse.reproduction.bench import Bench
from inverse.reproduction.row import Row

SECTION = "beam"
_QUARTER = 0.25  # of the intensity: -6 dB


class BeamSize(NamedTuple):
    """Full width and length [m] between the points where a map has fallen to a quarter of its peak."""

    width: float
    length: float


def beam_size(r: Float[np.ndarray, " r"], z: Float[np.ndarray, " z"], values: Float[np.ndarray, "r z"]) -> BeamSize:
    """Size of the focus of an intensity or force [any unit] at radii and positions [m].

    Accuracy: the logarithm is linear between points, of second order in their distance. NaN where the map ends before.
    """
    level = np.log(np.maximum(values / values.max(), 1e-30)) - np.log(_QUARTER)
    row, column = (int(index) for index in np.unravel_index(np.argmax(values), values.shape))
    across = _crossing(r[row:], level[row:, column])
    return BeamSize(
        2.0 * across, _crossing(z[column:], level[row, column:]) - _crossing(z[column::-1], level[row, column::-1])
    )


def _crossing(positions: Float[np.ndarray, " n"], level: Float[np.ndarray, " n"]) -> float:
    """Where a level that begins above zero first falls to it; NaN if it does nowhere."""
    if not np.any(level < 0.0):
        return np.nan
    after = int(np.argmax(level < 0.0))
    weight = level[after - 1] / (level[after - 1] - level[after])
    return float(positions[after - 1] + weight * (positions[after] - positions[after - 1]))


def beam_sizes(bench: Bench, pushing_power: float) -> dict[str, BeamSize]:
    """Force field at 35 degC: linear, and with harmonics at the heating's power and at `pushing_power` [W]."""
    start, heating = bench.protocol.start_temperature, float(bench.heating.acoustic_power)
    maps = {"linear": bench.linear(start)}
    for power in (heating, pushing_power):
        maps[f"harmonics at {power:.0f} W"] = bench.nonlinear(start, power)
    mesh = bench.settings.mesh
    return {name: beam_size(mesh.gauss_r, mesh.gauss_z, np.asarray(each.force)) for name, each in maps.items()}


def beam_rows(sizes: dict[str, BeamSize]) -> list[Row]:
    """Lesions of table 3 against the -6 dB force field: "about the size" at 60, "larger" at 65 degC says the text."""
    rows = []
    for name, size in sizes.items():
        for label, value in (("width", size.width), ("length", size.length)):
            why = "of the force at -6 dB, in the layers at 35 degC; the paper states none"
            rows.append(Row(SECTION, f"{label} of the force field, {name}", None, 1e3 * value, "mm", 0.0, why))
    linear = sizes["linear"]
    for temperature in (60.0, 65.0):
        column = suomi2016.TABLE_3_LESION[temperature]
        for label, lesion, beam in (
            ("diameter", column.diameter_mm, linear.width),
            ("length", column.length_mm, linear.length),
        ):
            share = lesion / (1e3 * beam)
            why = (
                "'approximately the size of the ARF field' at 60 degC: tolerance a quarter; with the table's numbers "
                f"as semi-axes {2.0 * share:.2f}"
                if temperature == 60.0
                else f"'larger than the ARF field' at 65 degC: 1 or more; as semi-axes {2.0 * share:.2f}"
            )
            quantity = f"lesion {label} of table 3 at {temperature:g} degC over that of the force field"
            rows.append(Row(SECTION, quantity, 1.0, share, "1", 0.25, why))
    return rows
