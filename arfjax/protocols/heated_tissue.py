"""What heat has made of the liver: where it has coagulated, how stiff it is, how hard sound pushes it.

Common to all protocols: they differ in where temperature and dose come from, and in what moves.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import radiation_force_density
from arfjax.errors import InputError
from arfjax.laws import Temperature, ViscoelasticLaw, common_range
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.material.harmonic import SolidField, solid_field
from arfjax.mechanics.material.inclusion import instantaneous_modulus, material_of, mixed
from arfjax.mechanics.material.lesion import Ellipsoid, coagulated_share
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.media import Scalar, Solid
from arfjax.model import DamageEdge, Model, TabulatedSize
from arfjax.protocols.discretisation import LIVER_RADIUS, Discretisation
from arfjax.thermal.lesion import LesionSize, lesion_size

_NO_SHARE = 1e-30
"""Share of the lesion below which no digit of liver's constants changes."""


def lesion_of(
    model: Model, focal_temperature: Scalar, dose: Float[Array, "r z"], settings: Discretisation
) -> LesionSize:
    """The lesion by the model's law of size.

    Args:
        model: The model.
        focal_temperature: Highest so far [degC], for a table of sizes.
        dose: In the cells of the heat grid [equivalent min at 43 degC].
        settings: Focus and heat grid.
    """
    size = model.lesion.size
    if isinstance(size, TabulatedSize):
        length, diameter = (jnp.asarray(law(focal_temperature)) for law in (size.length, size.diameter))
        return LesionSize(length, diameter, np.pi / 6.0 * length * diameter**2, jnp.asarray(settings.focus))
    return lesion_size(dose, settings.heat_grid, threshold=size.threshold)


def share_of(
    model: Model, size: LesionSize, dose: Float[Array, "r z"], settings: Discretisation, mesh: Mesh
) -> Float[Array, "rq zq"]:
    """Share of the lesion at a mesh's Gauss points by the model's edge.

    Args:
        model: The model.
        size: Of the lesion; the ellipsoid, if the edge is that of one.
        dose: In the cells of the heat grid [equivalent min at 43 degC].
        settings: Heat grid.
        mesh: Where the share is wanted.
    """
    edge = model.lesion.edge
    if isinstance(edge, DamageEdge):
        assert not isinstance(model.lesion.size, TabulatedSize)  # `Lesion` checks it
        return coagulated_share(mesh, settings.heat_grid, dose, threshold=model.lesion.size.threshold, width=edge.width)
    ellipsoid = Ellipsoid.of_length_and_diameter(size.length, size.diameter, centre=size.centre)
    return edge.share(ellipsoid, mesh.gauss_r[:, None], mesh.gauss_z[None, :])


def heated_solid(
    model: Model,
    temperature: Temperature,
    share: Float[Array, "rq zq"],
    lesion_temperature: Temperature | None = None,
) -> Solid:
    """Constants of liver of which a share is lesion, as fields.

    Args:
        model: The model.
        temperature: Of the liver [degC], one or a field.
        share: Of the lesion.
        lesion_temperature: That the lesion's constants are of [degC]; the liver's if not given.

    Raises:
        InputError: if the liver has no viscoelastic constants.
    """
    liver = model.liver.viscoelasticity
    if liver is None:
        raise InputError("the model's liver has no viscoelastic constants, which its motion needs.")
    hot = temperature if lesion_temperature is None else lesion_temperature
    lesion = model.lesion.viscoelasticity
    return mixed(liver(temperature), lesion(_of_lesion(lesion, hot, share)), share)


def _of_lesion(law: ViscoelasticLaw, temperature: Temperature, share: Float[Array, "rq zq"]) -> Temperature:
    """Temperature [degC] of the lesion's constants, within its laws' range where there is no lesion.

    Its laws need not make a solid there: relaxation times that fall with cold go below zero. Traced constants are not
    looked at, and what there is none of has no effect.
    """
    if isinstance(temperature, Tracer) or isinstance(share, Tracer):
        return temperature
    present = np.asarray(share) > _NO_SHARE
    if np.ndim(temperature) == 0:
        present = np.any(present)
    if np.all(present):
        return temperature
    given = jnp.asarray(temperature, dtype=float)
    return jnp.where(present, given, jnp.clip(given, *common_range(law)))


def material_in_time(model: Model, temperature: Temperature, solid: Solid, shape: tuple[int, ...]) -> ViscoelasticField:
    """A solid at Gauss points, as a push moves it; density is that of liver at `temperature` [degC]."""
    return material_of(
        solid,
        (shape[0], shape[1]),
        density=model.liver.density(temperature),
        reading=model.modulus_reading,
        poisson_ratio=model.poisson_ratio,
    )


def push_material(model: Model, temperature: Scalar, share: Float[Array, "rq zq"]) -> ViscoelasticField:
    """Liver at `temperature` [degC] at Gauss points, of which a share is lesion of that temperature."""
    return material_in_time(model, temperature, heated_solid(model, temperature, share), share.shape)


def material_at_frequencies(model: Model, temperature: Temperature, solid: Solid, shape: tuple[int, ...]) -> SolidField:
    """A solid at Gauss points with its exact modulus at every frequency; density as in `material_in_time`."""
    return solid_field(
        solid,
        (shape[0], shape[1]),
        density=model.liver.density(temperature),
        bulk_modulus=model.modulus_reading.bulk_modulus(instantaneous_modulus(solid), model.poisson_ratio),
        reading=model.modulus_reading,
        poisson_ratio=model.poisson_ratio,
    )


FieldAt = Callable[[Float[np.ndarray, " r"], Float[np.ndarray, " z"]], HarmonicField]
"""The sound field at radii and depths [m]."""


def force_on(mesh: Mesh, settings: Discretisation, field_at: FieldAt) -> Float[Array, "rq zq"]:
    """Radiation force density [N/m^3] at a mesh's Gauss points; none acts outside the liver."""
    front, back = settings.liver
    r, z = mesh.gauss_r, mesh.gauss_z
    outside = int(np.sum(r > LIVER_RADIUS)), int(np.sum(z < front)), int(np.sum(z > back))
    inside_r, inside_z = r[: len(r) - outside[0]], z[outside[1] : len(z) - outside[2]]
    return jnp.pad(radiation_force_density(field_at(inside_r, inside_z)), ((0, outside[0]), outside[1:]))
