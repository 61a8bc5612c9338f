"""The five-layer case at 150 W by another path than the package's march: makes `T*_P150.npz`. See SOURCE.md.

python -m tests.reference.acoustics.make_150 [--source T3 --power 50 --harmonics 64 --nodes 900 --refine 2 --out FILE]

Nothing is split here. The state is the Bessel coefficients of all harmonics, of which diffraction, attenuation and
dispersion are an exact factor over any length; nonlinearity and the absorbing ring are its right-hand side, stepped by
the classical rule of Runge and Kutta in the frame that this factor turns (Lawson 1967). The product p^2 is taken in
time at the radial nodes, with so many times that no harmonic is aliased. Only the bowl's start plane is the package's,
whose Rayleigh integral is held against O'Neil's formula. Plain numpy in double precision.
"""

import argparse
import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
from scipy import fft, special

from arfjax.acoustics.sources.radiating_bowl import RadiatingBowl
from arfjax.suomi2016 import TABLE_1_ACOUSTIC, AcousticRow
from arfjax.transducer import Drive, FocusedBowl

HERE = Path(__file__).parent
BOWL, FREQUENCY = FocusedBowl(32e-3, 10e-3, 62.6e-3), 1.1e6
RADIUS = 62e-3
"""Radius of the domain [m]."""
RIM = 62.6e-3 - (62.6e-3**2 - 32e-3**2) ** 0.5
STARTS = {"T1": (RIM, 150), "T2": (RIM + 0.5e-3, 147), "T3": (RIM + 0.5e-3, 147)}
"""Where the march starts in each case [m], and its steps in water. T3 is T2 steepening along the ray."""
STEEPEST = 0.6
"""Cosine of the steepest ray whose path counts in T3; the bowl's steepest has 0.86."""
T1_PRESSURE_AT_50_W = 209135.8
"""Pressure of T1 on the sphere of the bowl [Pa]."""
SPONGE_START, SPONGE_END, SPONGE_RATE = 44e-3, 60e-3, 400.0 / RADIUS
"""Where the ring begins and is full [m], and its full rate [Np/m]."""
LAYERS = {"water": (34e-3, 0), "skin": (36e-3, 12), "fat": (46e-3, 60), "muscle": (56e-3, 60), "liver": (96e-3, 238)}
"""Where each layer ends [m], and its steps beyond those of `STARTS`: an eighth of a wavelength in water."""
FOCAL_STEP = 39
"""Step in liver after which the focal plane lies, 62.555 mm from the apex."""
LIVE = 1e-13
"""Harmonics are carried once the last one carried reaches this share of the source pressure."""


class Medium:
    """Constants of a layer at each harmonic, from the paper's row."""

    def __init__(self, row: AcousticRow, n_harmonics: int):
        frequency = FREQUENCY * np.arange(1, n_harmonics + 1)
        ratio, exponent = frequency / 1e6, row.absorption_exponent
        loss = row.attenuation_db_per_cm_mhz * 100.0 / (20.0 / np.log(10.0))
        self.impedance = row.density * row.sound_speed
        self.lossless = 2.0 * np.pi * frequency / row.sound_speed
        self.attenuation = loss * ratio**exponent
        if exponent == 1.0:
            shape = -2.0 / np.pi * np.log(ratio)
        else:
            shape = np.tan(0.5 * np.pi * exponent) * (ratio ** (exponent - 1.0) - 1.0)
        slowness = 1.0 / row.sound_speed + loss / (2.0 * np.pi * 1e6) * shape
        self.wavenumber = 2.0 * np.pi * frequency * slowness - 1j * self.attenuation
        beta = 1.0 + 0.5 * row.nonlinearity_parameter
        self.steepening = beta / (2.0 * row.density * row.sound_speed**3)

    def axial_wavenumber(self, radial: np.ndarray, source: str) -> np.ndarray:
        """Root of k^2 - kappa^2 that decays, (mode, harmonic); for T1 with what tissue adds to k along the axis."""
        inside, beside = (self.lossless, self.wavenumber - self.lossless) if source == "T1" else (self.wavenumber, 0.0)
        root = np.sqrt(inside[None, :] ** 2 - radial[:, None] ** 2 + 0j)
        return np.where(root.imag > 0.0, -root, root) + beside

    def path(self, radial: np.ndarray, source: str) -> np.ndarray | None:
        """Path per axial distance along which a component steepens: k / k_z, as Westervelt's equation has it."""
        if source != "T3":
            return None
        sine = radial[:, None] / self.wavenumber.real[None, :]
        return 1.0 / np.sqrt(1.0 - np.minimum(sine**2, 1.0 - STEEPEST**2))


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


def slope(series: Series, medium: Medium, path: np.ndarray | None, amplitude: np.ndarray) -> np.ndarray:
    """Rate of change of the coefficients by nonlinearity and the ring."""
    n = amplitude.shape[1]
    pressure = apply(series.from_series, amplitude)
    n_times = fft.next_fast_len(3 * n + 1, real=True)
    spectrum = np.zeros((len(pressure), n_times // 2 + 1), dtype=complex)
    spectrum[:, 1 : n + 1] = pressure * (0.5 * n_times)  # a real part of a sum: half at either sign of frequency
    squared = fft.rfft(fft.irfft(spectrum, n=n_times, axis=1) ** 2, axis=1)[:, 1 : n + 1] * (2.0 / n_times)
    omega = 2j * np.pi * FREQUENCY * np.arange(1, n + 1)
    steepened, absorbed = medium.steepening * omega[None, :] * squared, series.sponge[:, None] * pressure
    if path is None:
        return apply(series.to_series, steepened - absorbed)
    return path[:, :n] * apply(series.to_series, steepened) - apply(series.to_series, absorbed)


def advance(rate: Callable[[np.ndarray], np.ndarray], amplitude: np.ndarray, half: np.ndarray, length: float):
    """One step of what changes at `rate`; `half` is the exact factor over half of it."""
    first = rate(amplitude)
    moved = half * amplitude
    second = rate(moved + half * first * (0.5 * length))
    third = rate(moved + second * (0.5 * length))
    fourth = rate(half * (moved + third * length))
    return half * (moved + length / 6.0 * (half * first + 2.0 * (second + third))) + length / 6.0 * fourth


def start(series: Series, source: str, power: float) -> tuple[np.ndarray, float]:
    """Coefficients of the fundamental on the start plane, and the source pressure [Pa]."""
    if source == "T1":
        pressure = T1_PRESSURE_AT_50_W * (power / 50.0) ** 0.5
        return pressure * projected_sphere(series), pressure
    water = TABLE_1_ACOUSTIC["water"]
    source_pressure = float(Drive(FREQUENCY, power).source_pressure(BOWL, water.density * water.sound_speed))
    wavenumber = jax.numpy.asarray(Medium(water, 1).wavenumber[0])
    inside = series.nodes < SPONGE_END
    pressure = np.zeros(len(series.nodes), dtype=complex)
    plane = STARTS["T2"][0]
    surface = RadiatingBowl(BOWL)
    pressure[inside] = surface.pressure_on_plane(
        source_pressure, wavenumber, series.nodes[inside], plane, n_quadrature=1600
    )
    return apply(series.to_series, (pressure * series.fade)[:, None])[:, 0], source_pressure


def projected_sphere(series: Series) -> np.ndarray:
    """Coefficients of d / R exp(i k (R - d)) on the plane of the rim, between the rays from hole and rim to the focus.

    Each is its integral by Gauss quadrature, so that the field's jumps at the edges do no harm.
    """
    focal, height = 62.6e-3, 62.6e-3 - RIM
    inner, outer = 10e-3 * height / (focal**2 - 10e-3**2) ** 0.5, 32e-3
    nodes, weights = np.polynomial.legendre.leggauss(2 * len(series.nodes))
    radius, weights = inner + 0.5 * (outer - inner) * (nodes + 1.0), 0.5 * (outer - inner) * weights
    distance = np.hypot(radius, height)
    k = Medium(TABLE_1_ACOUSTIC["water"], 1).lossless[0]
    values = radius * weights * focal / distance * np.exp(1j * k * (distance - focal))
    norms = 0.5 * RADIUS**2 * special.j1(series.radial * RADIUS) ** 2
    return special.j0(np.outer(series.radial, radius)) @ values / norms


@dataclasses.dataclass
class Record:
    """What is stored at each position on the axis; `phase` is that of a plane wave since the start plane."""

    z: list = dataclasses.field(default_factory=list)
    phase: list = dataclasses.field(default_factory=list)
    harmonics: list = dataclasses.field(default_factory=list)
    positive: list = dataclasses.field(default_factory=list)
    negative: list = dataclasses.field(default_factory=list)
    heat: list = dataclasses.field(default_factory=list)
    intensity: list = dataclasses.field(default_factory=list)

    def add(self, z: float, pressure: np.ndarray, medium: Medium, heats: bool) -> None:
        """`pressure` of all harmonics on the axis."""
        n_times = 64 * len(pressure)
        wave = fft.irfft(np.concatenate([[0.0], 0.5 * n_times * pressure]), n=n_times)
        since = z - self.z[-1] if self.z else 0.0
        self.phase.append(self.phase[-1] + since * medium.lossless[0] if self.z else 0.0)
        self.z.append(z)
        self.harmonics.append(np.pad(pressure, (0, 10))[:10])
        self.positive.append(wave.max())
        self.negative.append(wave.min())
        self.heat.append(heats * np.sum(medium.attenuation * np.abs(pressure) ** 2) / medium.impedance)
        self.intensity.append(np.sum(np.abs(pressure) ** 2) / (2.0 * medium.impedance))

    def stored_harmonics(self) -> np.ndarray:
        """For exp(-i n omega t), less the phase of a plane wave since the start plane, as `T2_P50.npz` has them."""
        return np.conj(np.asarray(self.harmonics) * np.exp(1j * np.outer(self.phase, np.arange(1, 11))))


def solve(source: str, power: float, n_harmonics: int, n_nodes: int, refine: int) -> dict[str, np.ndarray]:
    """The field's profiles, under the keys of `T2_P50.npz`."""
    series = Series(n_nodes)
    fundamental, source_pressure = start(series, source, power)
    amplitude = np.pad(fundamental[:, None], ((0, 0), (0, n_harmonics - 1)))
    record, live, before, plane = Record(), 4, None, {}
    depth, n_first = STARTS[source]
    for name, (end, n_beyond) in LAYERS.items():
        n_steps = n_beyond or n_first
        medium = Medium(TABLE_1_ACOUSTIC[name], n_harmonics)
        if before is None:
            record.add(depth, amplitude.sum(axis=0), medium, heats=False)
        else:
            amplitude = amplitude * (2.0 * medium.impedance / (before.impedance + medium.impedance))
        length = (end - depth) / (n_steps * refine)
        half = np.exp(-0.5j * length * medium.axial_wavenumber(series.radial, source))
        rate = functools.partial(slope, series, medium, medium.path(series.radial, source))
        for index in range(1, n_steps * refine + 1):
            amplitude[:, :live] = advance(rate, amplitude[:, :live], half[:, :live], length)
            if np.abs(amplitude[:, live - 1 : live]).max() > LIVE * source_pressure:
                live = min(live + 4, n_harmonics)
            record.add(depth + index * length, amplitude.sum(axis=0), medium, heats=name != "water")
            if name == "liver" and index == FOCAL_STEP * refine:
                plane = focal_plane(series, medium, amplitude, depth + index * length)
        depth, before = end, medium
    return {
        "z_m": np.asarray(record.z),
        "r_m": series.nodes,
        "p_axis_harmonics_pa": record.stored_harmonics(),
        "p_pos_axis_pa": np.asarray(record.positive),
        "p_neg_axis_pa": np.asarray(record.negative),
        "heat_axis_w_m3": np.asarray(record.heat),
        "intensity_axis_w_m2": np.asarray(record.intensity),
        **plane,
        "acoustic_power_w": np.asarray(power),
        "n_harmonics": np.asarray(live),
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
    parser.add_argument("--source", choices=STARTS, default="T2")
    parser.add_argument("--power", type=float, default=150.0)
    parser.add_argument("--harmonics", type=int, default=128, help="at most; see `LIVE`")
    parser.add_argument("--nodes", type=int, default=900)
    parser.add_argument("--refine", type=int, default=2, help="times more steps than `LAYERS` has")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    if asked.out is None and asked.power != 150.0:
        parser.error("--out is needed for another power: some fields at 50 W here are of another code.")
    jax.config.update("jax_enable_x64", True)
    result = solve(asked.source, asked.power, asked.harmonics, asked.nodes, asked.refine)
    np.savez_compressed(asked.out or HERE / f"{asked.source}_P150.npz", **result)
    liver = result["z_m"] > LAYERS["muscle"][0] + 1e-9
    print(  # noqa: T201
        f"p+ {result['p_pos_axis_pa'][liver].max() / 1e6:.4f} MPa, p- {result['p_neg_axis_pa'].min() / 1e6:.4f} MPa, "
        f"heat in liver {result['heat_axis_w_m3'][liver].max() / 1e6:.3f} W/cm3, "
        f"{result['n_harmonics']} harmonics carried"
    )


if __name__ == "__main__":
    main()
