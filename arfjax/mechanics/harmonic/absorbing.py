r"""Absorbing layers around a mesh: tissue without end, for motion that is harmonic in time.

Outside the mesh the coordinates leave the real line along a straight complex path (exterior complex scaling, a
perfectly matched layer whose stretch does not depend on frequency). With the time convention exp(+i omega t)

$$ \tilde r = R + (1 - i s)(r - R) \quad \text{for } r > R, $$

and likewise beyond both ends. The continued solution decays there as $e^{-s k (r - R)}$ where it was a wave of wave
number k, and as fast as before where it was none. Nothing is reflected where the layer begins, at any angle. The radius
is stretched wherever it stands: in derivatives, in the hoop strain and in the volume.

Since the path is straight and the solution smooth along it, elements may grow geometrically: a layer much thicker than
the tissue costs few of them, and one layer serves wavelengths from far below the size of the tissue to far above.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact

from arfjax.errors import InputError
from arfjax.grid import graded_positions
from arfjax.mechanics.elements.axisymmetric import volume_weights
from arfjax.mechanics.elements.matrices import (
    Metric,
    deviatoric_stiffness_of,
    mass_of,
    metric_of,
    volumetric_stiffness_of,
)
from arfjax.mechanics.elements.mesh import N_GAUSS, Mesh, Wall, Walls

Field = Inexact[Array, "rq zq"] | Inexact[np.ndarray, "rq zq"]


class AbsorbingLayer(eqx.Module):
    """Layer of stretched elements outside a mesh; its far end is held fast.

    The tissue in it is that of the mesh's edge, and no force acts in it. Its elements grow from the size of the
    mesh's last ones, which must resolve the waves (six or more to a wavelength).

    Accuracy: the layer's error at 50 Hz against exact motion of an infinite elastic medium (a round Gaussian force of
        2 mm 1/e radius in a box of 8 mm with elements of 0.5 mm, as a share of the largest amplitude; the default
        strength and growth). The same holds at any frequency: what counts is the wavelength.

        | shear wavelength | 4 mm | 8 mm | 20 mm | 50 mm | 0.2 m | 1 m | 10 m |
        | --- | --- | --- | --- | --- | --- | --- | --- |
        | 15 mm thick | 1e-3 | 7e-4 | 3e-3 | 6e-2 | 0.12 | 0.14 | 0.15 |
        | 50 mm | 1e-3 | 3e-4 | 2e-4 | 9e-4 | 3e-2 | 5e-2 | 5e-2 |
        | 0.2 m | 8e-4 | 3e-4 | 1.5e-4 | 1e-4 | 3e-4 | 8e-3 | 1.4e-2 |
        | 1 m | 8e-4 | 3e-4 | 1.5e-4 | 1e-4 | 1e-4 | 1.4e-4 | 2e-3 |
        | fixed box | | | | 0.4 | | | |

        A layer as thick as the longest wavelength is therefore enough; what is left at short ones are the elements of
        the tissue. Towards zero frequency the error is about the radius of the force over the thickness. Strengths
        from 0.5 to 2 and growths from 1.25 to 2 differ by less than a factor of three. `layer_error` measures the
        error of a layer in any problem.

    Attributes:
        thickness: Of the layer [m].
        strength: Imaginary over real part of the stretch [1]: 1 turns the path by 45 degrees.
        growth: Size of an element over that of its neighbour inwards [1].
        outer: Whether there is a layer beyond the largest radius; if not, the mesh's own wall holds there.
        bottom: Whether there is one below the smallest z.
        top: Whether there is one above the largest z.
    """

    thickness: float = eqx.field(static=True, default=0.5)
    strength: float = eqx.field(static=True, default=1.0)
    growth: float = eqx.field(static=True, default=1.5)
    outer: bool = eqx.field(static=True, default=True)
    bottom: bool = eqx.field(static=True, default=True)
    top: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        """Refuse a layer without thickness, one that amplifies, and elements that shrink outwards."""
        if not (self.thickness > 0.0 and self.strength >= 0.0 and self.growth >= 1.0):
            raise InputError(
                "an absorbing layer needs `thickness` > 0 m, `strength` >= 0 and `growth` >= 1, "
                f"got {self.thickness} m, {self.strength} and {self.growth}."
            )

    def refined(self) -> "AbsorbingLayer":
        """A layer four times as thick with finer elements, to measure the error of this one."""
        return dataclasses.replace(self, thickness=4.0 * self.thickness, growth=max(1.0, self.growth**0.5))

    def beyond(self, size: float) -> Float[np.ndarray, " n"]:
        """Distances [m] of the element edges from the tissue, whose last element has the given size [m]."""
        first = min(size * self.growth, self.thickness)
        return graded_positions(0.0, self.thickness, 0.0, finest=first, growth=self.growth, coarsest=self.thickness)[1:]


class StretchedMesh(eqx.Module):
    """A mesh with layers around it.

    Attributes:
        mesh: All elements, those of the layers included, in real coordinates.
        n_outer: Number of elements across the outer layer.
        n_bottom: Number across the layer at the smallest z.
        n_top: Number across the layer at the largest z.
        strength: Imaginary over real part of the stretch in the layers.
    """

    mesh: Mesh
    n_outer: int = eqx.field(static=True)
    n_bottom: int = eqx.field(static=True)
    n_top: int = eqx.field(static=True)
    strength: float = eqx.field(static=True)

    @property
    def tissue(self) -> tuple[slice, slice]:
        """Elements outside the layers, axial and radial."""
        n_r, n_z = self.mesh.shape
        return slice(self.n_bottom, n_z - self.n_top), slice(0, n_r - self.n_outer)

    def extend(self, field: Field) -> Inexact[Array, "rq_all zq_all"]:
        """A field of the tissue, continued into the layers as it is at their inner edge."""
        return jnp.pad(jnp.asarray(field), self._padding(N_GAUSS), mode="edge")

    def extend_by_zero(self, field: Field) -> Inexact[Array, "rq_all zq_all"]:
        """A field of the tissue that ends where the layers begin."""
        return jnp.pad(jnp.asarray(field), self._padding(N_GAUSS))

    def inner(self, nodal: Inexact[Array, "row column 2"]) -> Inexact[Array, "row_in column_in 2"]:
        """Nodal values in the tissue, its edge included."""
        rows, columns, _ = nodal.shape
        return nodal[2 * self.n_bottom : rows - 2 * self.n_top, : columns - 2 * self.n_outer]

    def _padding(self, factor: int) -> tuple[tuple[int, int], tuple[int, int]]:
        return (0, factor * self.n_outer), (factor * self.n_bottom, factor * self.n_top)

    def _stretch(self) -> tuple[Complex[np.ndarray, " er"], Complex[np.ndarray, " ez"]]:
        n_r, n_z = self.mesh.shape
        along_r, along_z = np.ones(n_r, complex), np.ones(n_z, complex)
        rows, columns = self.tissue
        along_r[columns.stop :] -= 1j * self.strength
        along_z[: rows.start] -= 1j * self.strength
        along_z[rows.stop :] -= 1j * self.strength
        return along_r, along_z

    def _radius_ratio(self) -> Complex[np.ndarray, "er 3"]:
        edge = self.mesh.r_edges[self.tissue[1].stop]
        radii = self.mesh.gauss_r
        return (1.0 - 1j * self.strength * np.maximum(radii - edge, 0.0) / radii).reshape(-1, N_GAUSS)

    def volume_weights(self) -> Complex[Array, "ez er 9"]:
        """Stretched volume [m^3] that each Gauss point stands for."""
        along_r, along_z = self._stretch()
        rings = np.tile(along_r[:, None] * self._radius_ratio(), (1, N_GAUSS))
        return volume_weights(self.mesh) * (along_z[:, None, None] * rings[None, :, :])

    def metric(self) -> Metric:
        """Lengths of the elements, stretched."""
        along_r, along_z = self._stretch()
        real, ratio = metric_of(self.mesh), np.tile(self._radius_ratio(), (1, N_GAUSS))
        return Metric(real.over_r / along_r, real.over_z / along_z, real.over_radius / ratio)


def stretched(mesh: Mesh, layer: AbsorbingLayer | None) -> StretchedMesh:
    """The mesh with the layer around it, or alone within its own walls."""
    if layer is None:
        return StretchedMesh(mesh, 0, 0, 0, 0.0)
    none = np.zeros(0)
    outer = layer.beyond(mesh.r_edges[-1] - mesh.r_edges[-2]) if layer.outer else none
    bottom = layer.beyond(mesh.z_edges[1] - mesh.z_edges[0]) if layer.bottom else none
    top = layer.beyond(mesh.z_edges[-1] - mesh.z_edges[-2]) if layer.top else none
    walls = Walls(
        Wall.FIXED if layer.outer else mesh.walls.outer,
        Wall.FIXED if layer.bottom else mesh.walls.bottom,
        Wall.FIXED if layer.top else mesh.walls.top,
    )
    z_edges = np.concatenate([mesh.z_edges[0] - bottom[::-1], mesh.z_edges, mesh.z_edges[-1] + top])
    whole = Mesh(np.concatenate([mesh.r_edges, mesh.r_edges[-1] + outer]), z_edges, walls)
    return StretchedMesh(whole, len(outer), len(bottom), len(top), layer.strength)


def dynamic_stiffness(
    space: StretchedMesh,
    density: Float[Array, "ez er 9"],
    bulk_modulus: Float[Array, "ez er 9"],
    shear_modulus: Complex[Array, "ez er 9"],
    angular_frequency: Float[Array, ""],
) -> Complex[Array, "ez er 18 18"]:
    """Complex symmetric matrix [N/m] of each element: stiffness less inertia, the linear pressure condensed."""
    weights, metric = space.volume_weights(), space.metric()
    inertia = mass_of(angular_frequency**2 * density * weights)
    both = jnp.einsum("zrij,cd->zricjd", inertia, jnp.eye(2, dtype=inertia.dtype))
    stiffness = deviatoric_stiffness_of(metric, shear_modulus * weights)
    stiffness = stiffness + volumetric_stiffness_of(metric, weights, bulk_modulus)
    return stiffness - both.reshape(stiffness.shape)
