"""The five-layer case at 150 W by another path than the package's march: makes `T2_P150.npz`. See SOURCE.md.

python -m tests.reference.acoustics.make_150 [--power 50 --harmonics 64 --nodes 900 --refine 1 --out FILE]

Nothing is split here. The state is the Bessel coefficients of all harmonics, of which diffraction, attenuation and
dispersion are an exact factor over any length; nonlinearity and the absorbing ring are its right-hand side, stepped by
the classical rule of Runge and Kutta in the frame that this factor turns (Lawson 1967). The product p^2 is taken in
time at the radial nodes, with so many times that no harmonic is aliased. Only the start plane is the package's, whose
Rayleigh integral is held against O'Neil's formula. Plain numpy in double precision.
"""

import argparse
import dataclasses
from pathlib import Path

import jax
import numpy as np
from scipy import fft, special

from arfjax.acoustics.source import bowl_pressure
from arfjax.suomi2016 import TABLE_1_ACOUSTIC, AcousticRow
from arfjax.transducer import Drive, FocusedBowl

HERE = Path(__file__).parent
BOWL, FREQUENCY = FocusedBowl(32e-3, 10e-3, 62.6e-3), 1.1e6
START, RADIUS = 9.297e-3, 62e-3
"""Start plane and radius of the domain [m]."""
SPONGE_START, SPONGE_END, SPONGE_RATE = 44e-3, 60e-3, 400.0 / RADIUS
"""Where the ring begins and is full [m], and its full rate [Np/m]."""
LAYERS = {"water": (34e-3, 147), "skin": (36e-3, 12), "fat": (46e-3, 60), "muscle": (56e-3, 60), "liver": (96e-3, 238)}
"""Where each layer ends [m], and its steps: an eighth of a wavelength in water."""
FOCAL_STEP = 39
"""Step in liver after which the focal plane lies, 62.555 mm from the apex."""
LIVE = 1e-13
"""Harmonics are carried once those below them reach this share of the source pressure."""


class Medium:
    """Constants of a layer at each harmonic, from the paper's row."""

    def __init__(self, row: AcousticRow, n_harmonics: int):
        frequency = FREQUENCY * np.arange(1, n_harmonics + 1)
        ratio, exponent = frequency / 1e6, row.absorption_exponent
        loss = row.attenuation_db_per_cm_mhz * 100.0 / (20.0 / np.log(10.0))
        self.impedance = row.density * row.sound_speed
        self.attenuation = loss * ratio**exponent
        if exponent == 1.0:
            shape = -2.0 / np.pi * np.log(ratio)
        else:
            shape = np.tan(0.5 * np.pi * exponent) * (ratio ** (exponent - 1.0) - 1.0)
        slowness = 1.0 / row.sound_speed + loss / (2.0 * np.pi * 1e6) * shape
        self.wavenumber = 2.0 * np.pi * frequency * slowness - 1j * self.attenuation
        beta = 1.0 + 0.5 * row.nonlinearity_parameter
        self.steepening = beta / (2.0 * row.density * row.sound_speed**3)

    def axial_wavenumber(self, radial: np.ndarray) -> np.ndarray:
        """Root of k^2 - kappa^2 that decays, (mode, harmonic)."""
        root = np.sqrt(self.wavenumber[None, :] ** 2 - radial[:, None] ** 2 + 0j)
        return np.where(root.imag > 0.0, -root, root)


class Series:
    """Bessel series on the disc, and its nodes."""

    def __init__(self, n: int):
        zeros = special.jn_zeros(0, n + 1)
        roots, limit = zeros[:-1], zeros[-1]
        self.nodes, self.radial = roots * RADIUS / limit, roots / RADIUS
        self.from_series = special.j0(np.outer(roots, roots) / limit)
        self.to_series = np.linalg.inv(self.from_series)
        depth = np.clip((self.nodes - SPONGE_START) / (SPONGE_END - SPONGE_START), 0.0, 1.0)
        self.sponge, self.fade = SPONGE_RATE * depth**2, np.cos(0.5 * np.pi * depth) ** 2


def apply(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Real matrix times complex columns."""
    return (matrix @ np.ascontiguousarray(values).view(float)).view(complex)


def slope(series: Series, medium: Medium, amplitude: np.ndarray) -> np.ndarray:
    """Rate of change of the coefficients by nonlinearity and the ring."""
    n = amplitude.shape[1]
    pressure = apply(series.from_series, amplitude)
    n_times = fft.next_fast_len(3 * n + 1, real=True)
    spectrum = np.zeros((len(pressure), n_times // 2 + 1), dtype=complex)
    spectrum[:, 1 : n + 1] = pressure * (0.5 * n_times)  # a real part of a sum: half at either sign of frequency
    squared = fft.rfft(fft.irfft(spectrum, n=n_times, axis=1) ** 2, axis=1)[:, 1 : n + 1] * (2.0 / n_times)
    omega = 2j * np.pi * FREQUENCY * np.arange(1, n + 1)
    rate = medium.steepening * omega[None, :] * squared - series.sponge[:, None] * pressure
    return apply(series.to_series, rate)


def advance(series: Series, medium: Medium, amplitude: np.ndarray, half: np.ndarray, length: float) -> np.ndarray:
    """One step; `half` is the exact factor over half of it."""
    first = slope(series, medium, amplitude)
    moved = half * amplitude
    second = slope(series, medium, moved + half * first * (0.5 * length))
    third = slope(series, medium, moved + second * (0.5 * length))
    fourth = slope(series, medium, half * (moved + third * length))
    return half * (moved + length / 6.0 * (half * first + 2.0 * (second + third))) + length / 6.0 * fourth


def start(series: Series, power: float) -> tuple[np.ndarray, float]:
    """Coefficients of the fundamental on the start plane, and the source pressure [Pa]."""
    water = TABLE_1_ACOUSTIC["water"]
    source = float(Drive(FREQUENCY, power).source_pressure(BOWL, water.density * water.sound_speed))
    wavenumber = jax.numpy.asarray(Medium(water, 1).wavenumber[0])
    inside = series.nodes < SPONGE_END
    pressure = np.zeros(len(series.nodes), dtype=complex)
    pressure[inside] = bowl_pressure(BOWL, source, wavenumber, series.nodes[inside], START, n_quadrature=1600)
    return apply(series.to_series, (pressure * series.fade)[:, None])[:, 0], source


@dataclasses.dataclass
class Record:
    """What is stored at each position on the axis."""

    z: list = dataclasses.field(default_factory=list)
    harmonics: list = dataclasses.field(default_factory=list)
    positive: list = dataclasses.field(default_factory=list)
    negative: list = dataclasses.field(default_factory=list)
    heat: list = dataclasses.field(default_factory=list)
    intensity: list = dataclasses.field(default_factory=list)
    last: list = dataclasses.field(default_factory=list)

    def add(self, z: float, pressure: np.ndarray, medium: Medium, heats: bool) -> None:
        """`pressure` of all harmonics on the axis."""
        n_times = 64 * len(pressure)
        wave = fft.irfft(np.concatenate([[0.0], 0.5 * n_times * pressure]), n=n_times)
        self.z.append(z)
        self.harmonics.append(np.pad(pressure, (0, 10))[:10])
        self.positive.append(wave.max())
        self.negative.append(wave.min())
        self.heat.append(heats * np.sum(medium.attenuation * np.abs(pressure) ** 2) / medium.impedance)
        self.intensity.append(np.sum(np.abs(pressure) ** 2) / (2.0 * medium.impedance))
        self.last.append(abs(pressure[-1]))


def solve(power: float, n_harmonics: int, n_nodes: int, refine: int) -> dict[str, np.ndarray]:
    """The field's profiles, under the keys of `T2_P50.npz`."""
    series = Series(n_nodes)
    fundamental, source = start(series, power)
    amplitude = np.pad(fundamental[:, None], ((0, 0), (0, n_harmonics - 1)))
    record, depth, live, before, plane = Record(), START, 4, None, {}
    for name, (end, n_steps) in LAYERS.items():
        medium = Medium(TABLE_1_ACOUSTIC[name], n_harmonics)
        if before is None:
            record.add(START, amplitude.sum(axis=0), medium, heats=False)
        else:
            amplitude = amplitude * (2.0 * medium.impedance / (before.impedance + medium.impedance))
        length = (end - depth) / (n_steps * refine)
        half = np.exp(-0.5j * length * medium.axial_wavenumber(series.radial))
        for index in range(1, n_steps * refine + 1):
            amplitude[:, :live] = advance(series, medium, amplitude[:, :live], half[:, :live], length)
            if np.abs(amplitude[:, live - 2 : live]).max() > LIVE * source:
                live = min(live + 4, n_harmonics)
            if index % refine == 0:
                record.add(depth + index * length, amplitude.sum(axis=0), medium, heats=name != "water")
            if name == "liver" and index == FOCAL_STEP * refine:
                plane = focal_plane(series, medium, amplitude, depth + index * length)
        depth, before = end, medium
    return {
        "z_m": np.asarray(record.z),
        "r_m": series.nodes,
        "p_axis_harmonics_pa": np.conj(record.harmonics),  # stored for exp(-i n omega t)
        "p_pos_axis_pa": np.asarray(record.positive),
        "p_neg_axis_pa": np.asarray(record.negative),
        "heat_axis_w_m3": np.asarray(record.heat),
        "intensity_axis_w_m2": np.asarray(record.intensity),
        "last_harmonic_axis_pa": np.asarray(record.last),
        **plane,
        "acoustic_power_w": np.asarray(power),
        "n_harmonics": np.asarray(n_harmonics),
    }


def focal_plane(series: Series, medium: Medium, amplitude: np.ndarray, z: float) -> dict[str, np.ndarray]:
    """Profiles across the beam at the nodes."""
    squares = np.abs(apply(series.from_series, amplitude)) ** 2
    return {
        "z_focal_plane_m": np.asarray(z),
        "heat_focal_plane_w_m3": (squares @ medium.attenuation / medium.impedance).astype(np.float32),
        "intensity_focal_plane_w_m2": (squares.sum(axis=1) / (2.0 * medium.impedance)).astype(np.float32),
        "p_harmonics_focal_plane_pa": np.sqrt(squares[:, :5]).astype(np.float32),
    }


def main() -> None:
    """Compute, say the peaks, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--power", type=float, default=150.0)
    parser.add_argument("--harmonics", type=int, default=128)
    parser.add_argument("--nodes", type=int, default=900)
    parser.add_argument("--refine", type=int, default=1, help="times more steps")
    parser.add_argument("--out", type=Path, default=HERE / "T2_P150.npz")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    result = solve(asked.power, asked.harmonics, asked.nodes, asked.refine)
    np.savez_compressed(asked.out, **result)
    liver = result["z_m"] > LAYERS["muscle"][0] + 1e-9
    print(  # noqa: T201
        f"p+ {result['p_pos_axis_pa'][liver].max() / 1e6:.4f} MPa, p- {result['p_neg_axis_pa'].min() / 1e6:.4f} MPa, "
        f"heat in liver {result['heat_axis_w_m3'][liver].max() / 1e6:.3f} W/cm3, "
        f"last harmonic {result['last_harmonic_axis_pa'].max():.3g} Pa"
    )


if __name__ == "__main__":
    main()
