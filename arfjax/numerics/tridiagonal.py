"""Many symmetric tridiagonal systems at once, factorised once and solved many times.

The unknowns run along the first axis; every other axis holds independent systems. Without pivoting, which diagonally
dominant matrices (diffusion) do not need. A solve takes 5 operations an unknown.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class TridiagonalFactor(eqx.Module):
    """Factors L D L^T of symmetric tridiagonal matrices: the multipliers below the diagonal of L, and 1 / D.

    `multiplier[i]` couples unknown i to unknown i - 1; `multiplier[0]` is zero.
    """

    multiplier: Float[Array, "n *systems"]
    inverse_pivot: Float[Array, "n *systems"]


def factorise(diagonal: Float[Array, "n *systems"], coupling: Float[Array, "n_less_1 *systems"]) -> TridiagonalFactor:
    """Factors of the matrices with `coupling[i]` between unknowns i and i + 1.

    No derivative flows through the factors: whoever solves with them supplies it.
    """
    diagonal, coupling = jax.lax.stop_gradient((diagonal, coupling))

    def step(inverse: Array, row: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        value, lower = row
        multiplier = lower * inverse
        inverse = 1.0 / (value - multiplier * lower)
        return inverse, (multiplier, inverse)

    lower = jnp.concatenate([jnp.zeros_like(diagonal[:1]), coupling])
    _, (multiplier, inverse) = jax.lax.scan(step, jnp.ones_like(diagonal[0]), (diagonal, lower))
    return TridiagonalFactor(multiplier, inverse)


def solve(factor: TridiagonalFactor, right_side: Float[Array, "n *systems"]) -> Float[Array, "n *systems"]:
    """Solutions of the factorised systems.

    Accuracy: backward stable for diagonally dominant matrices.
    """

    def down(previous: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        multiplier, value = row
        value = value - multiplier * previous
        return value, value

    def up(following: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        multiplier, value = row
        value = value - multiplier * following
        return value, value

    start = jnp.zeros_like(right_side[0])
    _, forward = jax.lax.scan(down, start, (factor.multiplier, right_side))
    above = jnp.concatenate([factor.multiplier[1:], jnp.zeros_like(factor.multiplier[:1])])
    _, solution = jax.lax.scan(up, start, (above, forward * factor.inverse_pivot), reverse=True)
    return solution
