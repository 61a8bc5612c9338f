"""Heat of the nonlinear field of the five-layer case over the (r, z) plane: makes `heat.npz`. See SOURCE.md.

python -m tests.reference.five_layer.make

Takes about a minute.
"""

from pathlib import Path

import equinox as eqx
import jax
import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.media import AcousticMedium
from arfjax.suomi2016 import TABLE_1_ACOUSTIC
from arfjax.transducer import Drive, FocusedBowl
from arfjax.units import from_db_per_cm

HERE = Path(__file__).parent
BOWL, DRIVE = FocusedBowl(32e-3, 10e-3, 62.6e-3), Drive(1.1e6, 50.0)
INTERFACES = {"water": 34e-3, "skin": 36e-3, "fat": 46e-3, "muscle": 56e-3, "liver": 96e-3}
"""Where each layer ends."""
STEP = 0.1684e-3  # m; an eighth of a wavelength in water
SETTINGS = MarchSettings(
    n_harmonics=32,
    n_radial=900,
    axial_step=STEP,
    start_plane=9.297e-3,
    sponge_start=44.0 / 62.0,
    sponge_end=60.0 / 62.0,
    n_quadrature=1600,  # the start is half a wavelength beyond the rim: evanescent waves count
    steepens_from_source=False,
)
RADII = np.linspace(0.0, 8e-3, 81)
LAST_DEPTH = 92e-3


def layers() -> list[AcousticLayer]:
    """The five layers."""
    ends, result = [0.0, *INTERFACES.values()], []
    for index, name in enumerate(INTERFACES):
        row = TABLE_1_ACOUSTIC[name]
        loss = from_db_per_cm(row.attenuation_db_per_cm_mhz)
        medium = AcousticMedium(row.density, row.sound_speed, loss, row.absorption_exponent, row.nonlinearity_parameter)
        result.append(AcousticLayer(medium, ends[index + 1] - ends[index]))
    return result


def heat_map() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths, layer of each, and heat at `RADII` and these depths; an interface occurs twice, once for each side."""
    beyond = 1e-6  # m; what the front of a layer is, where a position on an interface counts to the layer beyond it
    depths, owners = [], []
    starts = list(INTERFACES.values())[:-1]
    for index, (start, end) in enumerate(zip(starts, [*starts[1:], LAST_DEPTH], strict=True)):
        count = int(np.ceil((end - start) / STEP - 1e-9))
        inside = np.linspace(start, end, count + 1)
        inside[-1] -= beyond
        depths.append(inside)
        owners.append(np.full(len(inside), index + 1))
    z = np.concatenate(depths)
    solve = eqx.filter_jit(
        lambda drive: solve_field(
            BOWL,
            drive,
            layers(),
            r=RADII,
            z=z,
            settings=SETTINGS,
            diffraction=ExactOneWay(steepening_along_ray=False),  # as T2 has it
        )
    )
    field: HarmonicField = solve(DRIVE)
    return z, np.concatenate(owners), np.asarray(heat_deposition(field))


def main() -> None:
    """Write the map, and say how far it is from the other code's profiles of the same source."""
    jax.config.update("jax_enable_x64", True)
    z, layer, heat = heat_map()
    np.savez_compressed(HERE / "heat.npz", r=RADII, z=z, layer=layer, heat=heat.astype(np.float32))
    theirs = np.load(HERE / "profiles.npz")
    liver, inside = layer == 4, theirs["T2_z"] > INTERFACES["muscle"] + STEP
    inside &= theirs["T2_z"] < LAST_DEPTH - STEP
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
