"""The five-layer case that tests and benchmarks of heat share: grid, tissue and heat (tests/reference/five_layer)."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.interpolate import CubicSpline, RectBivariateSpline
from scipy.sparse.linalg import splu

from arfjax.grid import AxisymmetricGrid, graded_positions
from arfjax.suomi2016 import TABLE_1_ACOUSTIC
from arfjax.thermal.bioheat import Phase
from arfjax.thermal.conduction import ThermalField
from arfjax.tissues import BLOOD_SPECIFIC_HEAT

REFERENCE = Path(__file__).parents[1] / "reference" / "five_layer"
LAYERS = {  # end [m], conductivity [W/(m K)], specific heat [J/(kg K)], perfusion [kg/(m^3 s)]
    "skin": (36e-3, 0.37, 3391.0, 1.96),
    "fat": (46e-3, 0.21, 2348.0, 0.50),
    "muscle": (56e-3, 0.49, 3421.0, 0.67),
    "liver": (92e-3, 0.52, 3540.0, 15.2),
}
START, RADIUS, HOTTEST = 34e-3, 8e-3, 61e-3
BODY_TEMPERATURE = 37.0


def grid(refinement: float = 1.0) -> AxisymmetricGrid:
    """Finest about the hottest point; every interface is a face."""
    r = graded_positions(0.0, RADIUS, 0.0, finest=0.07e-3 / refinement, growth=1.0 + 0.08 / refinement, coarsest=1e-3)
    ends = [START, *(end for end, *_ in LAYERS.values())]
    z = [np.asarray([START])]
    for start, end in zip(ends[:-1], ends[1:], strict=True):
        centre = min(max(HOTTEST, start), end)
        away = max(abs(centre - HOTTEST) - 1e-3, 0.0)  # spacing grows with the distance from the hottest point
        finest = min(0.15e-3 + 0.08 * away, 2e-3) / refinement
        spacing = {"finest": finest, "growth": 1.0 + 0.08 / refinement, "coarsest": 2e-3 / refinement}
        z.append(graded_positions(start, end, centre, **spacing)[1:])
    return AxisymmetricGrid(r, np.concatenate(z))


def tissue(grid: AxisymmetricGrid) -> ThermalField:
    """Thermal constants of every cell."""
    rows = list(LAYERS.items())
    owner = np.searchsorted([end for _, (end, *_) in rows], grid.z)
    densities = np.asarray([TABLE_1_ACOUSTIC[name].density for name, _ in rows])
    _, conductivity, specific_heat, perfusion = (np.asarray(column) for column in zip(*LAYERS.values(), strict=True))
    ones = jnp.ones(grid.shape)
    return ThermalField(
        conductivity=ones * conductivity[owner][None, :],
        heat_capacity=ones * (densities * specific_heat)[owner][None, :],
        perfusion_conductance=ones * (BLOOD_SPECIFIC_HEAT * perfusion)[owner][None, :],
    )


def heat(case: str, grid: AxisymmetricGrid) -> Float[np.ndarray, "r z"]:
    """Mean heat of every cell [W/m^3] for the source "T1" or "T2"."""
    r, r_weights = _gauss(grid.r_faces)
    z, z_weights = _gauss(grid.z_faces)
    weights = r_weights * r
    values = np.concatenate([_layer_heat(case, index, r, z) for index in range(len(LAYERS))], axis=1)
    values = np.einsum("ra,raz->rz", weights, values.reshape(*r.shape, -1)) / weights.sum(axis=1)[:, None]
    return np.einsum("rzb,zb->rz", values.reshape(len(r), *z.shape), z_weights)


def phases(refinement: int = 1) -> tuple[Phase, ...]:
    """1 s of heating, 4 s of cooling, the first half second of which decides the dose."""
    return Phase(1.0, 20 * refinement), Phase(0.5, 10 * refinement, 0.0), Phase(3.5, 14 * refinement, 0.0)


def other_scheme(case: str, *, on_axis: float, spacing: float = 0.11e-3, n_steps: int = 200) -> tuple[float, float]:
    """Peak rise [K] and dose with R = 0.5 throughout [min] by the scheme of HITU_Simulator's heat solver.

    Finite differences, Crank and Nicolson's rule in 499 steps for 5 s, values on a uniform grid that begins on the
    axis, where the radial part of the Laplacian is `on_axis` (u1 - u0) / spacing^2: 4 is the limit of u'' + u' / r,
    that solver takes 2. What lies beyond the first 2 s and outside the focal region does not matter.
    """
    time_step, dz = 5.0 / 499.0, 0.13e-3
    r, z = np.arange(0.0, RADIUS - spacing, spacing), np.arange(50.05e-3, 75e-3, dz)
    sources = np.concatenate([_layer_heat(case, index, r, z) for index in range(len(LAYERS))], axis=1)
    owner = np.searchsorted([end for end, *_ in LAYERS.values()], z)
    density = np.asarray([TABLE_1_ACOUSTIC[name].density for name in LAYERS])[owner]
    _, conductivity, specific_heat, perfusion = (np.asarray(row)[owner] for row in zip(*LAYERS.values(), strict=True))
    above = np.concatenate([[on_axis], 1.0 + 0.5 * spacing / r[1:]]) / spacing**2
    below = np.concatenate([[0.0], 1.0 - 0.5 * spacing / r[1:]]) / spacing**2
    middle = np.where(r == 0.0, -on_axis, -2.0) / spacing**2
    radial = sparse.diags_array([below[1:], middle, above[:-1]], offsets=[-1, 0, 1])
    beside = np.full(len(z) - 1, 1.0 / dz**2)
    axial = sparse.diags_array([beside, np.full(len(z), -2.0 / dz**2), beside], offsets=[-1, 0, 1])
    laplacian = sparse.kron(radial, sparse.eye_array(len(z))) + sparse.kron(sparse.eye_array(len(r)), axial)

    def everywhere(along_z: np.ndarray) -> sparse.dia_array:
        return sparse.diags_array(np.tile(along_z, len(r)))

    diffusivity = conductivity / (density * specific_heat)
    rate = everywhere(diffusivity) @ laplacian - everywhere(perfusion / density)
    identity = sparse.eye_array(len(r) * len(z))
    implicit, explicit = splu((identity - 0.5 * time_step * rate).tocsc()), (identity + 0.5 * time_step * rate).tocsr()
    warming = (sources / (density * specific_heat)[None, :]).ravel()
    rise, dose, peak = np.zeros_like(warming), np.zeros_like(warming), 0.0
    for step in range(n_steps):
        heated = step * time_step < 1.0
        rise = implicit.solve(explicit @ rise + time_step * heated * warming)
        dose = dose + time_step / 60.0 * 2.0 ** (BODY_TEMPERATURE + rise - 43.0)
        peak = max(peak, rise.max())
    return float(peak), float(dose.max())


def _gauss(faces: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "cell 2"], Float[np.ndarray, "cell 2"]]:
    """Two Gauss points in every cell and their shares of it."""
    nodes, weights = np.polynomial.legendre.leggauss(2)
    centres, halves = 0.5 * (faces[1:] + faces[:-1]), 0.5 * np.diff(faces)
    return centres[:, None] + halves[:, None] * nodes[None, :], np.broadcast_to(0.5 * weights, (len(centres), 2))


def _layer_heat(case: str, index: int, r: np.ndarray, z: np.ndarray) -> Float[np.ndarray, "r z"]:
    """Heat at the positions of one layer, as flat lists."""
    ends = [START, *(end for end, *_ in LAYERS.values())]
    r, z = r.ravel(), z.ravel()
    z = z[(z > ends[index]) & (z < ends[index + 1])]
    ours = np.load(REFERENCE / "heat.npz")
    own = ours["layer"] == index + 1
    spline = RectBivariateSpline(ours["r"], ours["z"][own], ours["heat"][:, own])
    values = np.maximum(spline(r, z), 0.0)
    return values if case == "T2" else values * _other_source(r, z, index)


def _other_source(r: np.ndarray, z: np.ndarray, index: int) -> Float[np.ndarray, "r z"]:
    """Heat of T1 over that of T2, which is known along the axis and across the focal plane.

    Both are bounded to what they are where there is heat: at the nulls of the two fields they mean nothing.
    """
    profiles = np.load(REFERENCE / "profiles.npz")
    ends = [START, *(end for end, *_ in LAYERS.values())]

    def on_axis(case: str) -> np.ndarray:
        depth = profiles[f"{case}_z"]
        own = (depth > ends[index] + 1e-6) & (depth < ends[index + 1] - 1e-6)  # at an interface heat has two values
        return CubicSpline(depth[own], profiles[f"{case}_axis"][own])(z)

    along = np.clip(on_axis("T1") / np.maximum(on_axis("T2"), 1.0), 0.85, 1.02)
    across = profiles["T1_plane"] / profiles["T2_plane"]
    across = np.clip(np.interp(r, profiles["r"], across / across[0]), 0.9, 1.1)
    return across[:, None] * along[None, :]
