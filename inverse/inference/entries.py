r"""Entries of the flat vector of an inference: a parameter in one place, or one that differs from group to group.

A number that differs from sample to sample, or from sonication to sonication, is one `Varying` entry: the value of
group g is $f(f^{-1}(m) + s z_g)$ with the transform f, the value m of the middle of the population, its spread s and
independent standard normal $z_g$. Written so ("non-centred"), samplers do not stick where the spread is small.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy import stats
from jaxtyping import Array, Float, PRNGKeyArray

from arfjax.errors import InputError
from inverse.inference import places
from inverse.parameters import Parameter
from inverse.priors import ASSUMED, HalfNormal, Prior
from inverse.transforms import Identity, Positive, Transform


class Entry(eqx.Module):
    """A part of the flat vector that belongs together."""

    parameter: eqx.AbstractVar[Parameter]

    @property
    def name(self) -> str:
        """The parameter's."""
        return self.parameter.name

    @property
    def unit(self) -> str:
        """The parameter's."""
        return self.parameter.unit

    @property
    def places(self) -> tuple[str, ...]:
        """Where its numbers stand; none where a fit puts them in by hand."""
        return (self.parameter.place,) if self.parameter.place else ()

    @property
    @abc.abstractmethod
    def size(self) -> int:
        """Unconstrained numbers."""

    @property
    @abc.abstractmethod
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and title of each value."""

    @abc.abstractmethod
    def values(self, u: Float[Array, " n"]) -> Float[Array, " m"]:
        """Values from the unconstrained numbers."""

    @abc.abstractmethod
    def log_prior(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Logarithm of the prior density of the unconstrained numbers; 0 where there is no prior."""

    @abc.abstractmethod
    def draw(self, key: PRNGKeyArray) -> Float[Array, " n"]:
        """Unconstrained numbers from the prior."""

    @abc.abstractmethod
    def start(self, tree: Any) -> Float[Array, " n"]:
        """Unconstrained numbers of what stands in a tree."""

    @abc.abstractmethod
    def write(self, tree: Any, values: Float[Array, " m"]) -> Any:
        """The tree with these values in it."""

    @abc.abstractmethod
    def penalty(self, values: Float[Array, " m"]) -> Float[Array, " k"]:
        """What the priors add to the residuals of a fit, see `Prior.penalty`."""

    @abc.abstractmethod
    def ends(self, u: Float[np.ndarray, " n"]) -> list[str | None]:
        """For each value, the end of its range at which it lies, or None."""

    @property
    @abc.abstractmethod
    def beliefs(self) -> tuple[tuple[str, str], ...]:
        """What was believed of each value, in words, and the source of that."""


class Single(Entry):
    """One parameter, in one place."""

    parameter: Parameter

    @property
    def _count(self) -> int:
        return self.parameter.transform.n_values

    @property
    def size(self) -> int:
        """One, or one fewer than the shares of a whole."""
        return self.parameter.transform.n_unconstrained

    @property
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """The parameter; the shares of a whole are numbered."""
        parameter = self.parameter
        if self._count == 1:
            return ((parameter.name, parameter.unit, parameter.title),)
        return tuple((f"{parameter.name}[{k}]", parameter.unit, f"{parameter.title} {k}") for k in range(self._count))

    def values(self, u: Float[Array, " n"]) -> Float[Array, " m"]:
        """By the transform."""
        return jnp.atleast_1d(jnp.asarray(self.parameter.transform.forward(u[0] if self._count == 1 else u)))

    def log_prior(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Density of the value times derivative of the transform."""
        if self.parameter.prior is None:
            return jnp.zeros(())
        piece = u[0] if self._count == 1 else u
        value = self.parameter.transform.forward(piece)
        return self.parameter.prior.log_density(value) + self.parameter.transform.log_derivative(piece)

    def draw(self, key: PRNGKeyArray) -> Float[Array, " n"]:
        """From the prior.

        Raises:
            InputError: if the parameter has none.
        """
        return jnp.atleast_1d(jnp.asarray(self.parameter.transform.inverse(_believed(self.parameter).draw(key))))

    def start(self, tree: Any) -> Float[Array, " n"]:
        """What stands in the parameter's place; a factor starts at 1."""
        standing = 1.0 if self.parameter.relative else places.read(tree, self.parameter.place)
        return jnp.atleast_1d(jnp.asarray(self.parameter.transform.inverse(standing)))

    def write(self, tree: Any, values: Float[Array, " m"]) -> Any:
        """The value in its place."""
        value = values[0] if self._count == 1 else values
        return places.write(tree, self.parameter.place, value, relative=self.parameter.relative)

    def penalty(self, values: Float[Array, " m"]) -> Float[Array, " k"]:
        """The prior's, if there is one."""
        if self.parameter.prior is None:
            return jnp.zeros(0)
        value = values[0] if self._count == 1 else values
        return jnp.atleast_1d(jnp.asarray(self.parameter.prior.penalty(value)))

    def ends(self, u: Float[np.ndarray, " n"]) -> list[str | None]:
        """The transform's."""
        end = self.parameter.transform.end(float(u[0]) if self._count == 1 else jnp.asarray(u))
        return [end] * self._count

    @property
    def beliefs(self) -> tuple[tuple[str, str], ...]:
        """The prior, in words."""
        prior = self.parameter.prior
        unit = "" if self.parameter.unit == "1" else self.parameter.unit
        said = ("none", "") if prior is None else (prior.describe(unit), prior.source)
        return (said,) * self._count


class Varying(Entry):
    """A number that differs from group to group about the middle of a population.

    Attributes:
        parameter: Of the middle of the population. Its place holds `{group}` where the group's number goes, as in
            `solids[{group}].relaxed_modulus`.
        groups: What the groups are called.
        dimension: What a group is, such as "sample" or "sonication".
        spread: Prior of the population's standard deviation in the transform's coordinate: the logarithm of positive
            numbers, the logit of the place in a range, the number itself where it may be any.
    """

    parameter: Parameter
    groups: tuple[str, ...] = eqx.field(static=True)
    dimension: str = eqx.field(static=True)
    spread: HalfNormal = HalfNormal(0.5, source=ASSUMED)

    @property
    def places(self) -> tuple[str, ...]:
        """That of each group."""
        return tuple(self._place(group) for group in range(len(self.groups)))

    @property
    def size(self) -> int:
        """Middle, spread and one a group."""
        return 2 + len(self.groups)

    @property
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """Middle and spread of the population, then the value of each group."""
        name, unit, title = self.parameter.name, self.parameter.unit, self.parameter.title
        spread_unit = "1" if not isinstance(self.parameter.transform, Identity) else unit
        return (
            (f"{name}_population", unit, f"{title}, population"),
            (f"{name}_spread", spread_unit, f"{title}, spread"),
            *((f"{name}[{group}]", unit, f"{title}, {group}") for group in self.groups),
        )

    def values(self, u: Float[Array, " n"]) -> Float[Array, " m"]:
        """Middle, spread, values."""
        transform = self.parameter.transform
        spread = jnp.asarray(Positive(self.spread.sd).forward(u[1]))
        each = jax.vmap(lambda z: jnp.asarray(transform.forward(u[0] + spread * z)))(u[2:])
        return jnp.concatenate([jnp.stack([jnp.asarray(transform.forward(u[0])), spread]), each])

    def log_prior(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Of the middle, of the spread, and standard normal of the groups."""
        spread = Positive(self.spread.sd)
        return (
            Single(self.parameter).log_prior(u[:1])
            + self.spread.log_density(jnp.asarray(spread.forward(u[1])))
            + spread.log_derivative(u[1])
            + jnp.sum(stats.norm.logpdf(u[2:]))
        )

    def draw(self, key: PRNGKeyArray) -> Float[Array, " n"]:
        """A population, and groups from it."""
        middle, spread, groups = jax.random.split(key, 3)
        width = jnp.asarray(Positive(self.spread.sd).inverse(self.spread.draw(spread)))
        drawn = jax.random.normal(groups, (len(self.groups),))
        return jnp.concatenate([Single(self.parameter).draw(middle), width[None], drawn])

    def start(self, tree: Any) -> Float[Array, " n"]:
        """Half the prior's spread about the mean of what stands in the groups' places."""
        width = 0.5 * self.spread.sd
        transform = self.parameter.transform
        standing = [
            jnp.asarray(1.0 if self.parameter.relative else transform.inverse(places.read(tree, self._place(g))))
            for g in range(len(self.groups))
        ]
        if self.parameter.relative:
            standing = [jnp.asarray(transform.inverse(each)) for each in standing]
        coordinates = jnp.stack(standing)
        middle = jnp.mean(coordinates)
        log_width = jnp.asarray(Positive(self.spread.sd).inverse(width))
        return jnp.concatenate([jnp.stack([middle, log_width]), (coordinates - middle) / width])

    def write(self, tree: Any, values: Float[Array, " m"]) -> Any:
        """Every group's value in its place."""
        for group in range(len(self.groups)):
            tree = places.write(tree, self._place(group), values[2 + group], relative=self.parameter.relative)
        return tree

    def penalty(self, values: Float[Array, " m"]) -> Float[Array, " k"]:
        """Of the middle, of the spread, and of every group's distance from the middle."""
        transform = self.parameter.transform
        middle = jnp.asarray(transform.inverse(values[0]))
        distance = (jax.vmap(lambda value: jnp.asarray(transform.inverse(value)))(values[2:]) - middle) / values[1]
        spread = jnp.atleast_1d(jnp.asarray(self.spread.penalty(values[1])))
        return jnp.concatenate([Single(self.parameter).penalty(values[:1]), spread, distance])

    def ends(self, u: Float[np.ndarray, " n"]) -> list[str | None]:
        """Those of the middle and of the groups."""
        transform, spread = self.parameter.transform, float(Positive(self.spread.sd).forward(float(u[1])))
        return [transform.end(float(u[0])), None, *(transform.end(float(u[0] + spread * z)) for z in u[2:])]

    @property
    def beliefs(self) -> tuple[tuple[str, str], ...]:
        """The population's priors, in words."""
        drawn = (f"drawn from the population of {len(self.groups)} {self.dimension}s", "")
        return (
            *Single(self.parameter).beliefs,
            (self.spread.describe(""), self.spread.source),
            *((drawn,) * len(self.groups)),
        )

    def _place(self, group: int) -> str:
        return self.parameter.place.replace("{group}", str(group))


def parameter(
    name: str,
    place: str,
    unit: str,
    prior: Prior | None = None,
    *,
    transform: Transform | None = None,
    label: str = "",
    relative: bool = False,
) -> Single:
    """One parameter, with the transform that its prior asks for unless one is given."""
    if transform is None:
        transform = Identity() if prior is None else prior.transform
    return Single(Parameter(name, unit, transform, label, prior, place, relative))


def _believed(parameter: Parameter) -> Prior:
    if parameter.prior is None:
        raise InputError(f"`{parameter.name}` has no prior: give one, or fit by likelihood alone.")
    return parameter.prior
