"""What the tissue is at the Gauss points of a mesh, from solids and from closures on (r, z)."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.material.lesion import Points
from arfjax.mechanics.material.viscoelastic import (
    FieldOrScalar,
    ModulusReading,
    ViscoelasticField,
    prony_of,
    viscoelastic_field,
)
from arfjax.media import Elastic, FractionalKelvinVoigt, FractionalZener, KelvinVoigt, Prony, Scalar, Solid, Zener

SolidAt = Callable[[Points, Points], Solid]
"""A material: the solid at points r, z [m], its constants as fields of the shape that r and z broadcast to.

A number stands for a constant that is the same everywhere; so `lambda r, z: KelvinVoigt(2e3, 1.0)` is one too."""

_Constant = Scalar | Float[Array, "..."] | Float[np.ndarray, "..."]


class Inclusion(eqx.Module):
    """A material that goes from one solid to another of its kind with a share that a closure on (r, z) gives.

    Attributes:
        outside: Where the share is 0.
        inside: Where the share is 1.
        share: Of the inside, such as an `EllipsoidalLesion`.
    """

    outside: Solid
    inside: Solid
    share: Callable[[Points, Points], Float[Array, "..."]]

    def __call__(self, r: Points, z: Points) -> Solid:
        """The solid at points r, z [m]."""
        return mixed(self.outside, self.inside, self.share(r, z))


def mixed(outside: Solid, inside: Solid, share: Float[Array, "rq zq"] | Float[np.ndarray, "rq zq"]) -> Solid:
    """A solid whose every constant goes linearly from one solid's to another's.

    Raises:
        InputError: if they are not the same kind of solid.
    """
    if type(outside) is not type(inside):
        raise InputError(
            f"liver is a {type(outside).__name__} and the lesion a {type(inside).__name__}: "
            "give both the same kind of solid."
        )
    if isinstance(outside, Prony) and isinstance(inside, Prony):
        counts = [each.branch_moduli.shape[0] for each in (outside, inside)]
        if counts[0] != counts[1]:
            raise InputError(f"liver has {counts[0]} branches and the lesion {counts[1]}: give both as many.")
    return jax.tree.map(lambda first, second: _mixed_constant(first, second, jnp.asarray(share)), outside, inside)


def material_at(
    mesh: Mesh,
    solid_at: SolidAt,
    *,
    density: FieldOrScalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
    **windows: Any,
) -> ViscoelasticField:
    """The field of a material on a mesh, for the march in time.

    Args:
        mesh: The mesh.
        solid_at: The material.
        density: [kg/m^3], a number or a field.
        reading: Which moduli the solid's are.
        poisson_ratio: At instantaneous loading [1].
        **windows: What `prony_of` takes: `times` for viscosities, whose first is best the time step, `relative_window`
            and `tolerance` for fractional solids. The defaults are for a push of 0.5 ms.
    """
    solid = solid_at(jnp.asarray(mesh.gauss_r, dtype=float)[:, None], jnp.asarray(mesh.gauss_z, dtype=float)[None, :])
    return material_of(
        solid,
        (len(mesh.gauss_r), len(mesh.gauss_z)),
        density=density,
        reading=reading,
        poisson_ratio=poisson_ratio,
        **windows,
    )


def material_of(
    solid: Solid,
    shape: tuple[int, int],
    *,
    density: FieldOrScalar,
    reading: ModulusReading,
    poisson_ratio: Scalar,
    **windows: Any,
) -> ViscoelasticField:
    """The field of a solid whose constants are numbers or fields on the Gauss points, see `material_at`.

    The bulk modulus follows from Poisson's ratio and the instantaneous modulus: the paper states the former and not
    which modulus it goes with; for the displacement it makes less than 0.4 percent points.

    Raises:
        InputError: if it is a dashpot or a spring-pot alone, which has no spring that resistance to volume goes with.
    """
    is_fluid = isinstance(solid, KelvinVoigt | FractionalKelvinVoigt)
    if is_fluid and not lies_within(solid.relaxed_modulus, 0.0, above=True):
        raise InputError(
            f"a {type(solid).__name__} needs a modulus above 0 Pa, got {solid.relaxed_modulus}: its bulk modulus "
            "is taken from that. Give the spring some stiffness."
        )
    return viscoelastic_field(
        prony_of(solid, **windows),
        shape,
        density=density,
        bulk_modulus=reading.bulk_modulus(instantaneous_modulus(solid), poisson_ratio),
        reading=reading,
        poisson_ratio=poisson_ratio,
    )


def instantaneous_modulus(solid: Solid) -> Scalar | Float[Array, "..."]:
    """Modulus [Pa] at the start of a step of strain: the one that the bulk modulus goes with.

    A Kelvin-Voigt solid has none. Volume is elastic here, so that for it the spring's modulus is taken.
    """
    match solid:
        case Elastic():
            return solid.modulus
        case Zener() | FractionalZener():
            return solid.unrelaxed_modulus
        case KelvinVoigt() | FractionalKelvinVoigt():
            return solid.relaxed_modulus
        case Prony():
            return solid.relaxed_modulus + jnp.sum(jnp.asarray(solid.branch_moduli), axis=0)


def _mixed_constant(outside: _Constant, inside: _Constant, share: Float[Array, "rq zq"]) -> Float[Array, "..."]:
    first, second = jnp.asarray(outside, dtype=float), jnp.asarray(inside, dtype=float)
    # Branches of a Prony series, where it is one of numbers, have one axis.
    first, second = (each[:, None, None] if each.ndim == 1 else each for each in (first, second))
    return first + (second - first) * (share[None] if max(first.ndim, second.ndim) == 3 else share)
