"""Constants that differ from sonication to sonication about the middle of a population.

Sonications of one liver are not one experiment: each heats another place. A constant that is named here has a value
for each of them, drawn from a population whose middle and spread are inferred, too (`Varying`); the others are common
to all. Sweeps of DMA are of a sample of the same liver: where the solid of fresh liver differs, the sample is one more
member of its population.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax import InputError, Model
from arfjax.media import Scalar
from inverse.inference import places
from inverse.inference.entries import Entry, Single, Varying
from inverse.inference.parameter_set import ParameterSet
from inverse.parameters import Parameter
from inverse.priors import ASSUMED, HalfNormal, Normal

DIMENSION = "sonication"
SAMPLE = "sample of DMA"
"""What the member of a population is called that sweeps are of."""

_ROOT = "model."
_SEEN_BY_SWEEPS = "model.liver.viscoelasticity."


class Sonications(eqx.Module):
    """A model for every sonication, alike but for some constants.

    Attributes:
        common: The model, with what all sonications share.
        own: Of each constant that differs, its value for each sonication, then for the sample of sweeps if it counts.
        places: Where each of those constants stands in the model.
        count: How many sonications there are.
    """

    common: Model
    own: tuple[tuple[Scalar | Float[Array, ""], ...], ...]
    places: tuple[str, ...] = eqx.field(static=True)
    count: int = eqx.field(static=True)

    @property
    def models(self) -> tuple[Model, ...]:
        """The model of each sonication."""
        return tuple(self._of(member) for member in range(self.count))

    @property
    def liver(self) -> Any:
        """The liver that sweeps of DMA are of."""
        return self._of(self.count).liver

    def _of(self, member: int) -> Model:
        model = self.common
        for place, values in zip(self.places, self.own, strict=True):
            if member < len(values):
                model = places.write(model, place, jnp.asarray(values[member]))
        return model


def models_of(model: Model | Sonications, count: int) -> tuple[Model, ...]:
    """The model of each of so many sonications, all the same one where nothing differs."""
    return model.models if isinstance(model, Sonications) else (model,) * count


def across_sonications(
    parameters: ParameterSet,
    model: Model,
    names: Sequence[str],
    sonications: Sequence[str],
    *,
    spread: float = 0.5,
    with_sweeps: bool = False,
) -> tuple[ParameterSet, Sonications]:
    """The same parameters and model with some constants differing from sonication to sonication.

    Args:
        parameters: With places in the model.
        model: The model.
        names: Of the parameters that differ.
        sonications: What they are called.
        spread: Scale of the half-normal prior of each population's standard deviation: of the logarithm, where the
            constant's prior is log-normal or half-normal; of the logit of its place in the range (of its logarithm's,
            if log-uniform), where it is uniform; in standard deviations of the prior, where that is normal.
        with_sweeps: Whether sweeps of DMA are of a further member of the populations that they can tell of.

    Raises:
        InputError: if there is a single sonication, or a name is unknown or that of a noise.
    """
    if len(sonications) < 2:
        raise InputError(
            f"constants cannot differ from sonication to sonication in data of {len(sonications)}: give two or more, "
            "or leave `across_sonications` out."
        )
    varying = parameters.only(names).entries
    for entry in varying:
        if not entry.parameter.place.startswith(_ROOT) or not isinstance(entry, Single):
            raise InputError(f"`{entry.name}` is not one constant of the model: it cannot differ between sonications.")
    entries, own, own_places = list[Entry](), [], []
    for entry in parameters.entries:
        old = entry.parameter
        if not old.place.startswith(_ROOT) or not isinstance(entry, Single):
            entries.append(entry)
        elif entry in varying:
            seen = with_sweeps and old.place.startswith(_SEEN_BY_SWEEPS)
            labels = (*sonications, *((SAMPLE,) if seen else ()))
            place = old.place.removeprefix(_ROOT)
            moved = _moved(old, f"model.own[{len(own)}][{{group}}]")
            scale = spread * (old.prior.sd if isinstance(old.prior, Normal) else 1.0)
            entries.append(Varying(moved, labels, DIMENSION, HalfNormal(scale, source=ASSUMED)))
            own.append((places.read(model, place),) * len(labels))
            own_places.append(place)
        else:
            entries.append(Single(_moved(old, old.place.replace(_ROOT, "model.common.", 1))))
    return ParameterSet(tuple(entries)), Sonications(model, tuple(own), tuple(own_places), len(sonications))


def _moved(old: Parameter, place: str) -> Parameter:
    return Parameter(old.name, old.unit, old.transform, old.label, old.prior, place, old.relative)
