"""What every element of the force does to the displacement that is read: one push backward in time.

A push is linear in its force, so that the displacement at the geometric focus is a sum over the force at the Gauss
points, with weights that depend on the solid alone. With them a hundred beams cost no more than one.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.transient.push import solve_push
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.stepwise import StepwiseProtocol


def focal_response(
    material: ViscoelasticField, protocol: StepwiseProtocol, settings: Discretisation
) -> Float[Array, "rq zq"]:
    """Displacement at the geometric focus at the end of a push per force density at each Gauss point [m/(N/m^3)].

    The displacement of a force density is the sum of their product; quadrature weights are in the response.

    Args:
        material: The solid, such as from `push_material`.
        protocol: Which says how long the push is.
        settings: Mesh, focus and time steps; close over them under `jit`.

    Accuracy: that of `solve_push`, whose displacement the sum is to rounding.
    """

    def displacement(force: Float[Array, "rq zq"]) -> Float[Array, ""]:
        result = solve_push(settings.mesh, material, force, settings=protocol.push_steps(settings))
        return result.at_focus(settings.focus)[-1]

    return jax.grad(displacement)(jnp.zeros_like(material.density))
