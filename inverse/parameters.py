"""Parameters of a fit: what they are called, their unit, where they stand in a model, and what was believed of them.

Optimisers and samplers work on a flat vector of unconstrained numbers u; the transform of each parameter turns its
part of u into the value that the model takes.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from inverse.priors import Prior
from inverse.transforms import Transform


class Parameter(eqx.Module):
    """A number, or the shares of a whole, that a fit estimates.

    Attributes:
        name: Full name, as the model's field is called.
        unit: Unit of its value.
        transform: Keeps it inside its bounds.
        label: What figures and tables call it.
        prior: What was believed before the data; None in a fit by likelihood alone.
        place: Where it stands in the model, see `inverse.inference.places`; empty where a fit puts it in by hand.
        relative: Whether the value is a factor that multiplies what stands there, instead of taking its place.
    """

    name: str = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    transform: Transform
    label: str = eqx.field(static=True, default="")
    prior: Prior | None = None
    place: str = eqx.field(static=True, default="")
    relative: bool = eqx.field(static=True, default=False)

    @property
    def title(self) -> str:
        """Label, or name without underscores, for figures."""
        return self.label or self.name.replace("_", " ")


def constrain(parameters: tuple[Parameter, ...], unconstrained: Float[Array, " n"]) -> Float[Array, " values"]:
    """Values of the parameters from the vector of unconstrained numbers."""
    values, at = [], 0
    for parameter in parameters:
        count = parameter.transform.n_unconstrained
        piece = unconstrained[at] if parameter.transform.n_values == 1 else unconstrained[at : at + count]
        values.append(jnp.atleast_1d(jnp.asarray(parameter.transform.forward(piece))))
        at += count
    _check_length(at, len(unconstrained), "unconstrained numbers")
    return jnp.concatenate(values)


def unconstrain(parameters: tuple[Parameter, ...], values: Float[Array, " values"]) -> Float[Array, " n"]:
    """Vector of unconstrained numbers from the values of the parameters."""
    numbers, at = [], 0
    for parameter in parameters:
        count = parameter.transform.n_values
        piece = values[at] if count == 1 else values[at : at + count]
        numbers.append(jnp.atleast_1d(jnp.asarray(parameter.transform.inverse(piece))))
        at += count
    _check_length(at, len(values), "values")
    return jnp.concatenate(numbers)


def _check_length(wanted: int, given: int, what: str) -> None:
    if wanted != given:
        raise ValueError(f"these parameters have {wanted} {what}, got {given}.")
