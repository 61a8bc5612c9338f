"""Heat of the nonlinear field of the five-layer case over the (r, z) plane: makes `heat.npz`. See SOURCE.md.

python -m tests.reference.five_layer.make

The march is the package's own linear one, which carries harmonics; nonlinearity is added here as the operator at the
radial nodes. Takes about a minute.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from arfjax.acoustics import one_way
from arfjax.acoustics.absorption import attenuation, complex_wavenumber
from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.media import AcousticMedium
from arfjax.numerics.hankel import hankel_basis
from arfjax.suomi2016 import TABLE_1_ACOUSTIC
from arfjax.transducer import Drive, FocusedBowl
from arfjax.units import from_db_per_cm

HERE = Path(__file__).parent
BOWL, DRIVE = FocusedBowl(32e-3, 10e-3, 62.6e-3), Drive(1.1e6, 50.0)
INTERFACES = {"water": 34e-3, "skin": 36e-3, "fat": 46e-3, "muscle": 56e-3, "liver": 96e-3}
"""Where each layer ends."""
N_HARMONICS, N_TIMES = 32, 128
SETTINGS = one_way.MarchSettings(
    n_radial=900,
    axial_step=0.1684e-3,  # an eighth of a wavelength in water
    start_plane=9.297e-3,
    sponge_start=44.0 / 62.0,
    sponge_end=60.0 / 62.0,
    n_quadrature=1600,  # the start is half a wavelength beyond the rim: evanescent waves count
)
RADII = np.linspace(0.0, 8e-3, 81)
FIRST_DEPTH, LAST_DEPTH = 34e-3, 92e-3


def medium(name: str) -> AcousticMedium:
    row = TABLE_1_ACOUSTIC[name]
    loss = from_db_per_cm(row.attenuation_db_per_cm_mhz)
    return AcousticMedium(row.density, row.sound_speed, loss, row.absorption_exponent, row.nonlinearity_parameter)


def steepening(medium: AcousticMedium):
    """Burgers' operator over a step: dp/dz = beta / (2 rho c^3) d(p^2)/dt at fixed z, by Runge and Kutta's rule."""
    beta = 1.0 + 0.5 * medium.nonlinearity_parameter
    omega = 2.0 * np.pi * DRIVE.frequency
    rate = 1j * omega * beta / (2.0 * medium.density * medium.sound_speed**3) * np.arange(1, N_HARMONICS + 1)

    def slope(pressure):
        # Real part of a sum: irfft doubles each positive frequency, hence the halves.
        spectrum = jnp.pad(0.5 * N_TIMES * pressure, ((1, N_TIMES // 2 - N_HARMONICS), (0, 0)))
        squared = jnp.fft.irfft(spectrum, n=N_TIMES, axis=0) ** 2
        return rate[:, None] * jnp.fft.rfft(squared, axis=0)[1 : N_HARMONICS + 1] * (2.0 / N_TIMES)

    def step(pressure, length):
        first = slope(pressure)
        second = slope(pressure + 0.5 * length * first)
        third = slope(pressure + 0.5 * length * second)
        fourth = slope(pressure + length * third)
        return pressure + length / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)

    return step


def heat_map() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths, layer of each, and heat at `RADII` and these depths; an interface occurs twice, once for each side."""
    basis = hankel_basis(SETTINGS.n_radial, SETTINGS.domain_radius)
    frequency = DRIVE.frequency * jnp.arange(1, N_HARMONICS + 1)
    first = one_way._start(BOWL, DRIVE, medium("water"), frequency[:1], basis, SETTINGS)
    amplitude = jnp.pad(first, ((0, N_HARMONICS - 1), (0, 0)))
    sponge, evaluate = one_way._sponge(basis, SETTINGS), jnp.asarray(basis.evaluation_matrix(RADII))
    start, before, depths, owners, heats = SETTINGS.start_plane, None, [], [], []
    for index, (name, end) in enumerate(INTERFACES.items()):
        here = medium(name)
        steepen = steepening(here)
        if before is not None:
            amplitude = amplitude * one_way.transmission(before, here)
        wavenumber = ExactOneWay().axial_wavenumber(complex_wavenumber(here, frequency), jnp.asarray(basis.wavenumbers))
        positions, _ = one_way._march_positions(start, end, np.asarray([end]), SETTINGS.axial_step)
        history = one_way.march(
            amplitude,
            wavenumber,
            positions,
            basis,
            lambda pressure, length, steepen=steepen: sponge(steepen(pressure, length), length),
        )
        pressure = jnp.einsum("znm,rm->nrz", history, evaluate)
        lost = attenuation(here, frequency)[:, None, None] * jnp.abs(pressure) ** 2
        heats.append(np.asarray(jnp.sum(lost, axis=0) / (here.density * here.sound_speed)))
        depths.append(positions)
        owners.append(np.full(len(positions), index))
        amplitude, start, before = history[-1], end, here
    return np.concatenate(depths), np.concatenate(owners), np.concatenate(heats, axis=1)


def main() -> None:
    """Write the map, and say how far it is from the other code's profiles of the same source."""
    jax.config.update("jax_enable_x64", True)
    z, layer, heat = heat_map()
    kept = (z > FIRST_DEPTH - 1e-9) & (z < LAST_DEPTH) & (layer > 0)  # what water absorbs counts as none
    z, layer, heat = z[kept], layer[kept], heat[:, kept]
    np.savez_compressed(HERE / "heat.npz", r=RADII, z=z, layer=layer, heat=heat.astype(np.float32))
    theirs = np.load(HERE / "profiles.npz")
    liver, inside = layer == 4, theirs["T2_z"] > INTERFACES["muscle"] + SETTINGS.axial_step
    axis = CubicSpline(z[liver], heat[0, liver])(theirs["T2_z"][inside]) - theirs["T2_axis"][inside]
    plane = RectBivariateSpline(RADII, z[liver], heat[:, liver])(theirs["r"], theirs["z_focal_plane"])[:, 0]
    lines = [
        f"heat on axis in liver, mean square: {_ratio(axis, theirs['T2_axis'][inside]):.2e} of the other code's",
        f"heat in the focal plane:            {_ratio(plane - theirs['T2_plane'], theirs['T2_plane']):.2e}",
        f"peak in liver: {heat[0, liver].max():.5e} W/m^3, theirs {theirs['T2_axis'][inside].max():.5e}",
    ]
    print("\n".join(lines))  # noqa: T201


def _ratio(difference: np.ndarray, of: np.ndarray) -> float:
    return float(np.linalg.norm(difference) / np.linalg.norm(of))


if __name__ == "__main__":
    main()
