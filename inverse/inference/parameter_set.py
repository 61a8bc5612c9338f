r"""The parameters of an inference together: one flat vector of unconstrained numbers, its values, its prior.

A number that differs from sample to sample, or from sonication to sonication, is one `Varying` entry: the value of
group g is $f(f^{-1}(m) + s z_g)$ with the transform f, the value m of the middle of the population, its spread s and
independent standard normal $z_g$. Written so ("non-centred"), samplers do not stick where the spread is small.
"""

import abc
from collections.abc import Iterable, Sequence
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
        said = ("none", "") if prior is None else (prior.describe(self.parameter.unit), prior.source)
        return (said,) * self._count


class Varying(Entry):
    """A number that differs from group to group about the middle of a population.

    Attributes:
        parameter: Of the middle of the population. Its place holds `{group}` where the group's number goes, as in
            `solids[{group}].relaxed_modulus`.
        groups: What the groups are called.
        dimension: What a group is, such as "sample" or "sonication".
        spread: Prior of the population's standard deviation in the transform's coordinate: for positive numbers that
            of their logarithm.
    """

    parameter: Parameter
    groups: tuple[str, ...] = eqx.field(static=True)
    dimension: str = eqx.field(static=True)
    spread: HalfNormal = HalfNormal(0.5, source=ASSUMED)

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
            (self.spread.describe("1"), self.spread.source),
            *((drawn,) * len(self.groups)),
        )

    def _place(self, group: int) -> str:
        return self.parameter.place.replace("{group}", str(group))


class ParameterSet(eqx.Module):
    """All parameters of an inference.

    Attributes:
        entries: In the order of the flat vector.
    """

    entries: tuple[Entry, ...]

    def __check_init__(self) -> None:
        """Refuse two entries of one name."""
        names = [entry.name for entry in self.entries]
        double = sorted({name for name in names if names.count(name) > 1})
        if double:
            raise InputError(f"two parameters are called `{double[0]}`; names must differ.")

    @property
    def size(self) -> int:
        """Length of the flat vector."""
        return sum(entry.size for entry in self.entries)

    @property
    def columns(self) -> tuple[tuple[str, str, str], ...]:
        """Name, unit and title of each value."""
        return tuple(column for entry in self.entries for column in entry.columns)

    @property
    def is_plain(self) -> bool:
        """Whether every entry is one number, so that values and unconstrained numbers go one to one."""
        return all(isinstance(entry, Single) and entry.size == len(entry.columns) == 1 for entry in self.entries)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each value."""
        return tuple(name for name, _, _ in self.columns)

    @property
    def beliefs(self) -> tuple[tuple[str, str], ...]:
        """Prior and source of each value, in words."""
        return tuple(belief for entry in self.entries for belief in entry.beliefs)

    @property
    def has_priors(self) -> bool:
        """Whether every entry has a prior, so that there is a posterior."""
        return all(entry.parameter.prior is not None for entry in self.entries)

    def split(self, u: Float[Array, " n"]) -> list[Float[Array, " part"]]:
        """The part of the flat vector that belongs to each entry."""
        if u.shape != (self.size,):
            raise ValueError(f"these parameters have {self.size} unconstrained numbers, got shape {u.shape}.")
        ends = np.cumsum([entry.size for entry in self.entries])
        return [u[end - entry.size : end] for entry, end in zip(self.entries, ends, strict=True)]

    def values(self, u: Float[Array, " n"]) -> Float[Array, " m"]:
        """Values, in the order of `columns`."""
        return jnp.concatenate([entry.values(part) for entry, part in zip(self.entries, self.split(u), strict=True)])

    def log_prior(self, u: Float[Array, " n"]) -> Float[Array, ""]:
        """Logarithm of the prior density of the unconstrained numbers."""
        parts = zip(self.entries, self.split(u), strict=True)
        return jnp.sum(jnp.stack([jnp.reshape(entry.log_prior(part), ()) for entry, part in parts]))

    def draw(self, key: PRNGKeyArray) -> Float[Array, " n"]:
        """One flat vector from the prior."""
        keys = jax.random.split(key, len(self.entries))
        return jnp.concatenate([entry.draw(each) for entry, each in zip(self.entries, keys, strict=True)])

    def start(self, tree: Any) -> Float[Array, " n"]:
        """The flat vector of what stands in a tree."""
        return jnp.concatenate([entry.start(tree) for entry in self.entries])

    def write(self, tree: Any, values: Float[Array, " m"]) -> Any:
        """The tree with all values in their places."""
        for entry, part in zip(self.entries, self._split_values(values), strict=True):
            tree = entry.write(tree, part)
        return tree

    def penalties(self, values: Float[Array, " m"]) -> Float[Array, " k"]:
        """What all priors add to the residuals of a fit."""
        parts = zip(self.entries, self._split_values(values), strict=True)
        return jnp.concatenate([entry.penalty(part) for entry, part in parts])

    def _split_values(self, values: Float[Array, " m"]) -> list[Float[Array, " part"]]:
        counts = [len(entry.columns) for entry in self.entries]
        if values.shape != (sum(counts),):
            raise ValueError(f"these parameters have {sum(counts)} values, got shape {values.shape}.")
        ends = np.cumsum(counts)
        return [values[end - count : end] for count, end in zip(counts, ends, strict=True)]

    def ends(self, u: Float[np.ndarray, " n"]) -> list[str | None]:
        """For each value, the end of its range at which it lies, or None."""
        parts = self.split(jnp.asarray(u))
        return [end for entry, part in zip(self.entries, parts, strict=True) for end in entry.ends(np.asarray(part))]

    def only(self, names: Iterable[str]) -> "ParameterSet":
        """The entries of these names, in their order here; the others stay at what stands in the tree.

        Raises:
            InputError: if a name is unknown.
        """
        wanted = list(names)
        known = [entry.name for entry in self.entries]
        for name in wanted:
            if name not in known:
                raise InputError(f"no parameter is called `{name}`; there are {', '.join(known)}.")
        return ParameterSet(tuple(entry for entry in self.entries if entry.name in wanted))

    def without(self, names: Iterable[str]) -> "ParameterSet":
        """All entries but those of these names, which stay fixed.

        Raises:
            InputError: if a name is unknown.
        """
        held = {entry.name for entry in self.only(names).entries}
        return ParameterSet(tuple(entry for entry in self.entries if entry.name not in held))


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


def gather(entries: Sequence[Entry]) -> ParameterSet:
    """Parameters together."""
    return ParameterSet(tuple(entries))


def _believed(parameter: Parameter) -> Prior:
    if parameter.prior is None:
        raise InputError(f"`{parameter.name}` has no prior: give one, or fit by likelihood alone.")
    return parameter.prior
