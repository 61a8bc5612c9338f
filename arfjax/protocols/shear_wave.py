"""One push of heated liver, followed while its shear wave runs out: what shear-wave and HMI systems track.

The sound field, the lesion and the moduli are those of the stepwise protocol at one temperature; the push may last as
long as one likes, and the tissue is watched after it. For that the mesh is fine as far out as the wave runs.
"""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.refinement import focused_mesh
from arfjax.mechanics.transient.push import PushSettings, solve_push
from arfjax.mechanics.transient.shear_waves import arrival_times, of_one_front, shear_wave_speed, strain_on_grid
from arfjax.media import Scalar
from arfjax.model import Model
from arfjax.protocols.discretisation import LIVER_RADIUS, Discretisation
from arfjax.protocols.heated_tissue import push_material
from arfjax.protocols.stepwise import Heating, StepwiseProtocol, force_at, lesion_at, lesion_share
from arfjax.thermal.lesion import LesionSize

_SMALLEST_COUNT = 25
"""Steps in a push of 0.5 ms or less."""

_LONGEST_STEP = 40e-6  # s
_NEAR = 2.0
"""Widths of the force, from the axis, within which displacement is that of the push and not of a wave."""


class WatchSettings(eqx.Module):
    """How a push is followed.

    Attributes:
        duration: From the start of the push to the end of the run [s].
        radius: How far out the wave is followed [m]; within it elements are even.
        half_length: How far before and behind the focus displacement is kept [m].
        n_frames: Times at which the map is kept, evenly spaced, the start not counted.
        element: Radial size of the even elements [m]; axially three times that.
    """

    duration: float = eqx.field(static=True, default=8e-3)
    radius: float = eqx.field(static=True, default=10e-3)
    half_length: float = eqx.field(static=True, default=10e-3)
    n_frames: int = eqx.field(static=True, default=80)
    element: float = eqx.field(static=True, default=0.25e-3)

    def __check_init__(self) -> None:
        """Refuse what cannot be meant."""
        lengths = (self.duration, self.radius, self.half_length, self.element)
        if not all(0.0 < length < math.inf for length in lengths) or self.n_frames < 5:
            raise InputError(
                "following a push needs a positive duration, radius, half length and element, and five frames or more, "
                f"got {self.duration} s, {self.radius}, {self.half_length}, {self.element} m and {self.n_frames}."
            )
        if self.radius >= LIVER_RADIUS:
            raise InputError(f"`radius` {self.radius} m must be below the liver's, {LIVER_RADIUS} m.")


class WatchedPush(eqx.Module):
    """A push and what came after it.

    Attributes:
        time: Of the frames [s], the first is 0.
        r: Radii of the frames [m].
        z: Axial positions of the frames [m].
        displacement: Along the push [m].
        strain: rr, zz, tt and rz (engineering shear) [1], of second order in half an element.
        focal_time: Of the course at the focus [s].
        focal_displacement: At the geometric focus [m].
        arrival: When displacement in the focal plane is largest [s]; NaN within the force and where it has not come.
        speed: Of the wave in the focal plane [m/s], a straight line through the arrivals.
        lesion: What of the tissue is one.
    """

    time: Float[Array, " frame"]
    r: Float[np.ndarray, " r"]
    z: Float[np.ndarray, " z"]
    displacement: Float[Array, "frame r z"]
    strain: Float[Array, "frame r z 4"]
    focal_time: Float[Array, " time"]
    focal_displacement: Float[Array, " time"]
    arrival: Float[Array, " r"]
    speed: Float[Array, ""]
    lesion: LesionSize


def watch_mesh(settings: Discretisation, watch: WatchSettings) -> Mesh:
    """Elements of the liver, even as far out as the wave is followed, with the walls and layer of `settings`."""
    front, back = settings.liver
    return focused_mesh(
        focus=settings.focus,
        radius=LIVER_RADIUS,
        front=front,
        back=back,
        finest_r=watch.element,
        finest_z=3.0 * watch.element,
        fine_radius=watch.radius,
        fine_length=2.0 * min(watch.half_length, settings.focus - front, back - settings.focus),
        coarsest=3e-3,
        walls=settings.mesh.walls,
        outer_layer=settings.outer_layer,
    )


def watch_push(
    model: Model,
    temperature: Scalar,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    heating: Heating,
    watch: WatchSettings = WatchSettings(),  # noqa: B008  frozen and without state
) -> WatchedPush:
    """Push liver at `temperature` [degC] for the protocol's duration and follow it.

    Args:
        model: The model; derivatives flow to every leaf of it.
        temperature: Of liver and focus [degC].
        protocol: Whose push it is.
        settings: Sound field and focus; the mesh is made anew.
        heating: The sonication, which says how large the lesion is by then.
        watch: What is kept.

    Raises:
        InputError: if the push is longer than it is watched.

    Accuracy: the mesh's, third order in `element`; the wave is resolved while `element` is below a sixth of the
        force's width. What reaches the walls, at about c_p within 1 ms, is reflected there.
    """
    if protocol.push_duration > watch.duration:
        raise InputError(
            f"a push of {1e3 * protocol.push_duration:g} ms is longer than it is watched, {1e3 * watch.duration:g} ms."
        )
    mesh, lesion = watch_mesh(settings, watch), lesion_at(model, heating, temperature, settings)
    share = lesion_share(model, heating, temperature, lesion, settings, mesh)
    force = force_at(model, temperature, protocol, settings, mesh)
    steps = _steps(protocol, watch)
    # Displacement at all nodes, of which every other one, an element's edge, is kept: strain needs its neighbours.
    node_r = mesh.node_r[: 2 * int(np.sum(mesh.r_edges <= watch.radius * (1.0 + 1e-9))) - 1]
    kept = np.flatnonzero(np.abs(mesh.z_edges - settings.focus) <= watch.half_length * (1.0 + 1e-9))
    node_z = mesh.node_z[2 * kept[0] : 2 * kept[-1] + 1]
    r, z = node_r[::2], node_z[::2]
    points = np.stack([each.ravel() for each in np.meshgrid(node_r, node_z, indexing="ij")], axis=1)
    in_plane = np.stack([r, np.full_like(r, settings.focus)], axis=1)
    result = solve_push(
        mesh,
        push_material(model, temperature, share),
        force,
        settings=steps,
        points=np.concatenate([points, in_plane]),
    )
    frames = np.unique(np.round(np.linspace(0, steps.n_steps, watch.n_frames + 1)).astype(int))
    passed = arrival_times(result.time, result.displacement_at_points[:, len(points) :, 1])
    maps = result.displacement_at_points[frames, : len(points)].reshape(len(frames), len(node_r), len(node_z), 2)
    arrival = of_one_front(jnp.where(r > _force_width(force, mesh, settings.focus), passed, jnp.nan))
    return WatchedPush(
        time=result.time[frames],
        r=r,
        z=z,
        displacement=maps[:, ::2, ::2, 1],
        strain=strain_on_grid(node_r, node_z, maps)[:, ::2, ::2],
        focal_time=result.time,
        focal_displacement=result.at_focus(settings.focus),
        arrival=arrival,
        speed=shear_wave_speed(r, arrival),
        lesion=lesion,
    )


def _steps(protocol: StepwiseProtocol, watch: WatchSettings) -> PushSettings:
    """Steps that divide the push, and the run as nearly as they can."""
    push = protocol.push_duration
    length = push / max(_SMALLEST_COUNT, math.ceil(push / _LONGEST_STEP))
    return PushSettings(length, math.ceil(watch.duration / length - 1e-9), push, modulation=protocol.modulation)


def _force_width(force: Float[Array, "rq zq"], mesh: Mesh, focus: float) -> Float[Array, ""]:
    """Radius [m] beyond which what moves is a wave: twice that which holds half of the force in the focal plane."""
    row = int(np.argmin(np.abs(mesh.gauss_z - focus)))
    rings = jnp.cumsum(jnp.abs(force[:, row]) * jnp.asarray(mesh.gauss_r * np.gradient(mesh.gauss_r), dtype=float))
    half = jnp.argmax(rings >= 0.5 * rings[-1])
    return _NEAR * jnp.asarray(mesh.gauss_r, dtype=float)[half]
