r"""The time step of the heat equation: implicit along r and along z in turn.

With heat capacity C and conduction K = K_r + K_z of all cells, the rise u above the initial temperature obeys
C u' = P - K u. One step of length h is the two-stage Rosenbrock-W method (Verwer et al., SIAM J. Sci. Comput. 20 (1999)
1456)

    M k1 = P - K u
    M k2 = P - K (u + h k1) - 2 C k1
    u   <- u + h (3 k1 + k2) / 2

which is of second order whatever M is. M is C + gamma h K in factors, each tridiagonal:

    M = (C + gamma h K_r) C^-1 (C + gamma h K_z)

K_r holds conduction along r and the outer wall, K_z conduction along z, blood and the end walls. What flows from cell
to cell cancels in the sum over all cells in either factor, so that what the heat delivers is stored or lost to the
last bit, although M is not C + gamma h K. The error of the factors is of the order (gamma h)^2 K_r C^-1 K_z u', small
for the long focus of a bowl: on the five-layer case errors agree to three digits with those of solving with
C + gamma h K itself, which takes five to nine times as long (benchmarks/thermal.py).
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.media import Scalar
from arfjax.numerics.tridiagonal import TridiagonalFactor, factorise, solve
from arfjax.thermal.conduction import Conductances

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
"""Of the two values that damp stiff modes completely (when K is K_r or K_z alone) the one with the smaller error."""

Cells = Float[Array, "r z"]


class SplitOperator(eqx.Module):
    """The matrix M of a step, ready to be solved with many times.

    Attributes:
        capacity: C [J/K].
        conductances: K [W/K].
        weight: gamma times the time step [s].
    """

    capacity: Cells
    conductances: Conductances
    weight: Scalar
    along_r: TridiagonalFactor
    along_z: TridiagonalFactor

    def multiply(self, rate: Cells) -> Cells:
        """M times a rate of temperature [K/s]: a power [W]."""
        part = rate + self.weight * self.conductances.leaving_along_z(rate) / self.capacity
        return self.capacity * part + self.weight * self.conductances.leaving_along_r(part)

    def solve(self, power: Cells) -> Cells:
        """The rate [K/s] that M turns into `power` [W]; derivatives come from `multiply`, not from the factors."""
        return jax.lax.custom_linear_solve(
            self.multiply, power, solve=lambda _, right: self.substitute(right), transpose_solve=self._transposed
        )

    def substitute(self, power: Cells) -> Cells:
        """As `solve`, without derivatives of its own."""
        return solve(self.along_z, (self.capacity * solve(self.along_r, power)).T).T

    def substitute_transposed(self, power: Cells) -> Cells:
        """As `substitute`, for the transpose of M."""
        return solve(self.along_r, self.capacity * solve(self.along_z, power.T).T)

    def _transposed(self, _: Callable, power: Cells) -> Cells:
        return self.substitute_transposed(power)


def split_operator(capacity: Cells, conductances: Conductances, time_step: Scalar) -> SplitOperator:
    """M for one length of step [s]."""
    weight = GAMMA * time_step
    along_r = factorise(capacity + weight * conductances.diagonal_along_r(), -weight * conductances.radial)
    along_z = factorise((capacity + weight * conductances.diagonal_along_z()).T, -weight * conductances.axial.T)
    return SplitOperator(capacity, conductances, weight, along_r, along_z)


def march(
    operator: SplitOperator, power: Cells, rise: Cells, time_step: Scalar, n_steps: int
) -> Float[Array, "step r z"]:
    """Rises [K] after each of `n_steps` steps from `rise`, under a `power` [W] into each cell that stays the same.

    All steps together are one linear system for the rates and rises of all of them. Its solution is the march forward,
    that of its transpose a march backward, and its derivatives are those of one product with the whole history: in
    either mode they cost one more march and memory for the history, not the derivative of every operation.
    """
    conductances, capacity = operator.conductances, operator.capacity
    power = power - conductances.leaving(rise)
    # Of each step: first rate, second rate, change of the rise since the start of the march; in one array, because
    # the transpose of a linear solve needs a derivative to all of what it gave.
    right_side = jnp.broadcast_to(jnp.stack([power, power, jnp.zeros_like(power)]), (n_steps, 3, *power.shape))

    def multiply(history: Float[Array, "step 3 r z"]) -> Float[Array, "step 3 r z"]:
        change = history[:, 2]
        return jax.vmap(residual)(jnp.concatenate([jnp.zeros_like(change[:1]), change[:-1]]), history)

    def residual(before: Cells, entry: Float[Array, "3 r z"]) -> Float[Array, "3 r z"]:
        first, second, change = entry
        of_first = operator.multiply(first) + conductances.leaving(before)
        of_second = operator.multiply(second) + 2.0 * capacity * first
        of_second = of_second + conductances.leaving(before + time_step * first)
        return jnp.stack([of_first, of_second, change - advance(before, first, second, time_step)])

    def forward(_: Callable, right_side: Float[Array, "step 3 r z"]) -> Float[Array, "step 3 r z"]:
        def step(before: Cells, given: Float[Array, "3 r z"]) -> tuple[Cells, Float[Array, "3 r z"]]:
            first = operator.substitute(given[0] - conductances.leaving(before))
            leaving = conductances.leaving(before + time_step * first)
            second = operator.substitute(given[1] - leaving - 2.0 * capacity * first)
            change = given[2] + advance(before, first, second, time_step)
            return change, jnp.stack([first, second, change])

        return jax.lax.scan(step, jnp.zeros_like(rise), right_side)[1]

    def backward(_: Callable, right_side: Float[Array, "step 3 r z"]) -> Float[Array, "step 3 r z"]:
        def step(later: Cells, given: Float[Array, "3 r z"]) -> tuple[Cells, Float[Array, "3 r z"]]:
            change = given[2] + later
            second = operator.substitute_transposed(given[1] + 0.5 * time_step * change)
            through = 2.0 * capacity * second + time_step * conductances.leaving(second)
            first = operator.substitute_transposed(given[0] - through + 1.5 * time_step * change)
            return change - conductances.leaving(first + second), jnp.stack([first, second, change])

        return jax.lax.scan(step, jnp.zeros_like(rise), right_side, reverse=True)[1]

    history = jax.lax.custom_linear_solve(multiply, right_side, solve=forward, transpose_solve=backward)
    return rise[None] + history[:, 2]


def advance(rise: Cells, first: Cells, second: Cells, time_step: Scalar) -> Cells:
    """The rise one step later [K]."""
    return rise + time_step * (1.5 * first + 0.5 * second)
