"""The same parameters with priors that reach further: what a fast model is prepared with."""

import equinox as eqx

from inverse.inference.parameter_set import Entry, ParameterSet, Single, Varying, parameter
from inverse.priors import HalfNormal, LogNormal, Normal, Prior


def widened(parameters: ParameterSet, factor: float) -> ParameterSet:
    """Parameters with spreads or logarithmic widths multiplied by a factor; uniform ranges stay as they are.

    What lies outside a uniform prior has no posterior density, so that no sampler asks for it.
    """
    return ParameterSet(tuple(_wide(entry, factor) for entry in parameters.entries))


def _wide(entry: Entry, factor: float) -> Entry:
    old = entry.parameter
    if isinstance(entry, Varying):
        middle = _wide(Single(old), factor).parameter
        spread = HalfNormal(entry.spread.sd * factor, source=entry.spread.source)
        return Varying(middle, entry.groups, entry.dimension, spread)
    if old.prior is None:
        return entry
    return parameter(old.name, old.place, old.unit, _wider(old.prior, factor), label=old.label, relative=old.relative)


def _wider(prior: Prior, factor: float) -> Prior:
    if isinstance(prior, Normal | HalfNormal):
        return eqx.tree_at(lambda one: one.sd, prior, prior.sd * factor)
    if isinstance(prior, LogNormal):
        return eqx.tree_at(lambda one: one.log_sd, prior, prior.log_sd * factor)
    return prior
