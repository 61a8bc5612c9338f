"""The nonlinear field of five layers against converged solutions of other codes (`tests/reference/acoustics`).

T1: projected source, absorption and steepening along the axis, as the free HITU_Simulator has it. T2: true bowl,
absorption along the path, steepening along the axis. T3: as T2, steepening along the path. All of them start to steepen
at the start plane.
"""

from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from arfjax.acoustics.diffraction import ExactOneWay
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.acoustics.waveform import peak_pressures
from arfjax.media import AcousticMedium
from arfjax.suomi2016 import TABLE_1_ACOUSTIC
from arfjax.transducer import Drive, FocusedBowl, PressureDrive
from arfjax.units import from_db_per_cm

STORED = Path(__file__).parent.parent / "reference" / "acoustics"
BOWL = FocusedBowl(32e-3, 10e-3, 62.6e-3)
THICKNESSES = {"water": 34e-3, "skin": 2e-3, "fat": 10e-3, "muscle": 10e-3, "liver": 40e-3}
SOURCE_PRESSURE = {50: 209135.8, 150: 209135.8 * np.sqrt(3.0)}  # of T1
ALONG_AXIS = ExactOneWay(steepening_along_ray=False)


def layers():
    result = []
    for name, thickness in THICKNESSES.items():
        row = TABLE_1_ACOUSTIC[name]
        lost = from_db_per_cm(row.attenuation_db_per_cm_mhz)
        medium = AcousticMedium(row.density, row.sound_speed, lost, row.absorption_exponent, row.nonlinearity_parameter)
        result.append(AcousticLayer(medium, thickness))
    return result


CASES = {
    "T1": (
        lambda power: (ProjectedBowl(BOWL, fade_grazing=True), PressureDrive(1.1e6, SOURCE_PRESSURE[power])),
        ExactOneWay(absorption_along_ray=False, steepening_along_ray=False),
    ),
    "T2": (lambda power: (BOWL, Drive(1.1e6, power)), ALONG_AXIS),
    "T3": (lambda power: (BOWL, Drive(1.1e6, power)), ExactOneWay()),
}
SETTINGS = {
    50: MarchSettings(
        n_harmonics=24, axial_step=0.449e-3, start_plane=9.297e-3, n_quadrature=640, steepens_from_source=False
    ),
    150: MarchSettings(
        n_harmonics=48,
        n_radial=576,
        axial_step=0.449e-3,
        start_plane=9.297e-3,
        n_quadrature=640,
        n_substeps=2,
        steepens_from_source=False,
    ),
}


def solve(case, power, r, z, settings=None):
    (source, drive), diffraction = CASES[case][0](float(power) if case != "T1" else power), CASES[case][1]
    settings = SETTINGS[power] if settings is None else settings
    each = eqx.filter_jit(
        lambda drive: solve_field(source, drive, layers(), r=r, z=z, settings=settings, diffraction=diffraction)
    )
    return each(drive)


@pytest.mark.parametrize(
    ("case", "power"),
    [("T2", 50), *(pytest.param(*each, marks=pytest.mark.slow) for each in (("T1", 50), ("T3", 50)))]
    + [pytest.param(case, 150, marks=pytest.mark.slow) for case in CASES],
)
def test_pressure_and_heat_are_those_of_other_codes(case, power):
    """p+ and p- within 0.1 %, heat within 0.3 % of their peaks, at the same positions about the focus."""
    stored = np.load(STORED / f"{case}_P{power}.npz")
    near = np.flatnonzero((stored["z_m"] > 57e-3) & (stored["z_m"] < 70e-3))[::4]
    plane = float(stored["z_focal_plane_m"])
    z = np.sort(np.append(stored["z_m"][near], plane) if plane not in stored["z_m"][near] else stored["z_m"][near])
    r = np.concatenate([[0.0], stored["r_m"][stored["r_m"] < 4e-3]])
    field = solve(case, power, r, z)
    on_axis = np.searchsorted(z, stored["z_m"][near])
    positive, negative = (np.asarray(each)[0, on_axis] for each in peak_pressures(field))
    heat = np.asarray(heat_deposition(field))
    for ours, key, tolerance in (
        (positive, "p_pos_axis_pa", 1e-3),
        (negative, "p_neg_axis_pa", 1e-3),
        (heat[0, on_axis], "heat_axis_w_m3", 3e-3),
    ):
        theirs = stored[key][near]
        assert np.abs(ours - theirs).max() < tolerance * np.abs(theirs).max(), key
    across = heat[1:, np.searchsorted(z, plane)] - stored["heat_focal_plane_w_m3"][: len(r) - 1]
    assert np.abs(across).max() < 3e-3 * stored["heat_focal_plane_w_m3"].max()


def test_single_precision_is_as_good():
    z = np.linspace(57e-3, 70e-3, 27)
    double = solve("T2", 50, np.zeros(1), z)
    with jax.enable_x64(False):
        single = solve("T2", 50, np.zeros(1), z)
    assert single.pressure.dtype == np.complex64
    with jax.enable_x64(False):
        peaks = peak_pressures(single)
    for ours, theirs in zip(peaks, peak_pressures(double), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=2e-4 * np.abs(theirs).max())
    np.testing.assert_allclose(*(heat_deposition(each)[0] for each in (single, double)), rtol=1e-3)
