"""The parameters of an inference together: one flat vector of unconstrained numbers, its values, its prior."""

from collections.abc import Callable, Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from arfjax.errors import InputError
from inverse.inference.entries import Entry as Entry
from inverse.inference.entries import Single as Single
from inverse.inference.entries import Varying as Varying
from inverse.inference.entries import parameter as parameter


def require_own_places(entries: Iterable[Entry], written: Callable[[str], str] = str) -> None:
    """Refuse two entries in one place, where the second would overwrite the first.

    Args:
        entries: Of a set.
        written: The one way to write a place, where there are several.
    """
    standing: dict[str, str] = {}
    for entry in entries:
        for place in map(written, entry.places):
            if standing.setdefault(place, entry.name) != entry.name:
                raise InputError(
                    f"parameters `{standing[place]}` and `{entry.name}` have the same place, `{place}`, "
                    "which holds the value of one alone; leave the other out, or correct its place."
                )


class ParameterSet(eqx.Module):
    """All parameters of an inference.

    Attributes:
        entries: In the order of the flat vector.
    """

    entries: tuple[Entry, ...]

    def __check_init__(self) -> None:
        """Refuse two values of one name, whether of two entries or of two groups of one, and two entries in a place."""
        entries = [entry.name for entry in self.entries]
        names = entries if len(set(entries)) < len(entries) else list(self.names)
        double = sorted({name for name in names if names.count(name) > 1})
        if double:
            raise InputError(f"two parameters are called `{double[0]}`; names must differ.")
        require_own_places(self.entries)

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
