"""Whole liver of one stiffness and one attenuation: the paper's second study, a map over both.

The displacement is linear in the force, which does not depend on stiffness, and the solid does not depend on
attenuation: with one response for each modulus (`focal_response`) and one sound field for each attenuation the whole
map is a product of two matrices, exactly.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.laws import Constant
from arfjax.mechanics.material.inclusion import material_of
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.media import Scalar, Zener
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.response import focal_response
from arfjax.protocols.stepwise import StepwiseProtocol, force_at

RELAXED_MODULUS = 8.0  # Pa; Suomi et al. 2016, text of the second study
RELAXATION_TIME = 0.5  # s; the same


def homogeneous_material(
    model: Model,
    branch_modulus: Scalar,
    settings: Discretisation,
    *,
    temperature: Scalar,
    relaxed_modulus: Scalar = RELAXED_MODULUS,
    relaxation_time: Scalar = RELAXATION_TIME,
) -> ViscoelasticField:
    """Liver that is one conventional Zener solid everywhere, at the Gauss points.

    Args:
        model: Whose density, reading of the moduli and Poisson's ratio they are.
        branch_modulus: M_inf - M_0 [Pa].
        settings: Whose mesh it is.
        temperature: At which the density is taken [degC].
        relaxed_modulus: M_0 [Pa].
        relaxation_time: [s].
    """
    return material_of(
        Zener(relaxed_modulus, relaxed_modulus + branch_modulus, relaxation_time),
        (len(settings.mesh.gauss_r), len(settings.mesh.gauss_z)),
        density=model.liver.density(temperature),
        reading=model.modulus_reading,
        poisson_ratio=model.poisson_ratio,
    )


def force_of_attenuation(
    model: Model, attenuation: Scalar, protocol: StepwiseProtocol, settings: Discretisation
) -> Float[Array, "rq zq"]:
    """Force density [N/m^3] at the Gauss points in liver of one attenuation at 1 MHz [Np/m], at the model's power."""
    law = Constant(attenuation, unit="Np/m", source="prescribed")
    changed = dataclasses.replace(model, liver=dataclasses.replace(model.liver, attenuation=law))
    return force_at(changed, protocol.start_temperature, protocol, settings)


def displacement_map(
    model: Model,
    branch_modulus: Float[Array, " modulus"] | Float[np.ndarray, " modulus"],
    attenuation: Float[Array, " attenuation"] | Float[np.ndarray, " attenuation"],
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    relaxed_modulus: Scalar = RELAXED_MODULUS,
    relaxation_time: Scalar = RELAXATION_TIME,
) -> Float[Array, "modulus attenuation"]:
    """Focal displacement [m] at the end of a push of homogeneous liver, for every pair of stiffness and attenuation.

    Args:
        model: Transducer, power and layers; its lesion and liver's own moduli and attenuation play no part.
        branch_modulus: M_inf - M_0 of the liver [Pa].
        attenuation: Of the liver at 1 MHz [Np/m].
        protocol: Which says how long the push is, and the temperature of the layers.
        settings: Grids, mesh and steps; close over them under `jit`.
        relaxed_modulus: M_0 [Pa].
        relaxation_time: [s].

    Accuracy: that of single pushes, which it equals to rounding. A map of n x m takes n pushes (forward and back) and
        m sound fields, of which the layers before the liver are computed once.
    """
    # One after the other: a batch would hold the factors of every solid's stiffness at once.
    responses = jax.lax.map(
        lambda modulus: focal_response(
            homogeneous_material(
                model,
                modulus,
                settings,
                temperature=protocol.start_temperature,
                relaxed_modulus=relaxed_modulus,
                relaxation_time=relaxation_time,
            ),
            protocol,
            settings,
        ),
        jnp.asarray(branch_modulus, dtype=float),
    )
    forces = jax.vmap(lambda each: force_of_attenuation(model, each, protocol, settings))(
        jnp.asarray(attenuation, dtype=float)
    )
    return jnp.einsum("mrz,arz->ma", responses, forces)
