"""A posterior as it is kept: draws in units, what they predict, what was believed before, how they were made."""

import datetime
import importlib.metadata
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Float, PRNGKeyArray

from inverse.inference.noise import NoiseModel
from inverse.inference.parameter_set import Entry, ParameterSet, Varying
from inverse.inference.problem import Measurement, Problem
from inverse.sampling.diagnostics import values_of
from inverse.sampling.draws import Draws
from inverse.sampling.inference_data import ARVIZ_VERSION, bundle, groups_of
from inverse.sampling.target import batched_values, coordinate_names, prior_points

_MOST_ENSEMBLE_DRAWS = 20_000


def posterior_record(
    problem: Problem,
    draws: Draws,
    *,
    seed: int = 0,
    predictive: int = 500,
    prior: int = 2000,
    pointwise: bool = True,
    attributes: dict[str, str | int | float] | None = None,
) -> Any:
    """Draws as an object of ArviZ, to be saved by `save_posterior`.

    Walkers of an ensemble are thinned, which the attribute `thinned_by` says, since neighbouring steps tell the same.

    Args:
        problem: Whose posterior was sampled.
        draws: From any sampler.
        seed: Of predictions and draws of the prior.
        predictive: Draws, evenly over the posterior and as many of the prior, for which data are predicted.
        prior: Draws of the prior.
        pointwise: Whether to keep the log likelihood of each datum for each draw, for comparisons of models.
        attributes: To be kept beside ours.

    Returns:
        Groups `posterior` (values, by name, in units), `unconstrained_posterior`, `sample_stats`, `log_likelihood` (of
        measurements whose data are not tied by a common reference), `posterior_predictive`, `prior`, `prior_predictive`
        and `observed_data`. Predictive groups hold `<measurement>`, with noise, and `<measurement>_mean`, without;
        draws for which the model predicts nothing, such as beyond a fast one's range, are left out of them, and
        their attributes `draws_asked` and `draws_left_out` say how many.
    """
    draws = _thinned(draws)
    before, after, believed = jax.random.split(jax.random.key(seed), 3)
    points = prior_points(problem, believed, prior)
    chosen = draws.spread_evenly(predictive)
    groups = {
        "posterior": _values(problem.parameters, values_of(problem, draws)),
        "unconstrained_posterior": _unconstrained(problem, draws),
        "sample_stats": _statistics(draws),
        "posterior_predictive": _predicted(problem, chosen, after),
        "prior": _values(problem.parameters, batched_values(problem, points)[None]),
        "prior_predictive": _predicted(problem, points[: len(chosen)], before),
        "observed_data": _observed(problem),
    }
    likelihood = _pointwise(problem, draws) if pointwise else None
    if likelihood is not None:
        groups["log_likelihood"] = likelihood
    said = {
        "sampler": draws.sampler,
        "seed": draws.seed,
        "predictive_seed": seed,
        "stopping_rule_met": int(draws.finished),
        "stopping_reason": draws.message,
        "seconds": draws.seconds,
        "evaluations": draws.evaluations,
        "arfjax_version": _own_version(),
        "jax_version": jax.__version__,
        "arviz_version": ARVIZ_VERSION,
        "created_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    return bundle(
        groups, {**said, **{f"sampler_{name}": v for name, v in draws.settings.items()}, **(attributes or {})}
    )


def left_out(record: Any) -> str:
    """A sentence on draws of the prior that the model predicts nothing for; empty if there are none."""
    counts = groups_of(record)["prior_predictive"].attrs
    if not counts["draws_left_out"]:
        return ""
    return (
        f"Of {counts['draws_asked']} draws of the prior, {counts['draws_left_out']} lie where the model predicts "
        "nothing: they are left out of `prior_predictive` in posterior.nc, which is narrower than the prior for that."
    )


def _own_version() -> str:
    try:
        return importlib.metadata.version("arfjax")
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _thinned(draws: Draws) -> Draws:
    if not draws.walkers or draws.log_density.size <= _MOST_ENSEMBLE_DRAWS:
        return draws
    return draws.thinned(int(np.ceil(draws.log_density.size / _MOST_ENSEMBLE_DRAWS)))


def _values(parameters: ParameterSet, values: Float[np.ndarray, "chain draw m"]) -> xr.Dataset:
    """Values by name; groups and shares along a dimension of their own."""
    data = xr.Dataset(coords=_sample_coordinates(values.shape[:2]))
    at = 0
    for entry in parameters.entries:
        count = len(entry.columns)
        data = _put(data, entry, values[:, :, at : at + count])
        at += count
    return data


def _put(data: xr.Dataset, entry: Entry, values: Float[np.ndarray, "chain draw k"]) -> xr.Dataset:
    columns = entry.columns
    title = entry.parameter.title
    if isinstance(entry, Varying):
        for index in (0, 1):
            name, unit, said = columns[index]
            data[name] = (("chain", "draw"), values[:, :, index], {"units": unit, "long_name": said})
        dimension = entry.dimension
        if dimension in data.coords and tuple(data[dimension].to_numpy()) != entry.groups:
            dimension = f"{dimension}_of_{entry.name}"
        data = data.assign_coords({dimension: list(entry.groups)})
        data[entry.name] = (
            ("chain", "draw", dimension),
            values[:, :, 2:],
            {"units": entry.unit, "long_name": title},
        )
    elif len(columns) == 1:
        data[entry.name] = (("chain", "draw"), values[:, :, 0], {"units": entry.unit, "long_name": title})
    else:
        share = f"{entry.name}_share"
        data = data.assign_coords({share: np.arange(len(columns))})
        data[entry.name] = (("chain", "draw", share), values, {"units": entry.unit, "long_name": title})
    return data


def _sample_coordinates(shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    return {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}


def _unconstrained(problem: Problem, draws: Draws) -> xr.Dataset:
    data = xr.Dataset(coords=_sample_coordinates(draws.log_density.shape))
    names = list(coordinate_names(problem.parameters))
    return data.assign_coords(coordinate=names).assign(
        unconstrained=(
            ("chain", "draw", "coordinate"),
            draws.unconstrained,
            {"units": "1", "long_name": "numbers that samplers move"},
        )
    )


def _statistics(draws: Draws) -> xr.Dataset:
    data = xr.Dataset(coords=_sample_coordinates(draws.log_density.shape))
    data["lp"] = (("chain", "draw"), draws.log_density, {"units": "1", "long_name": "log posterior density of u"})
    for name, values in draws.statistics.items():
        data[name] = (("chain", "draw"), values, {"units": "1", "long_name": name.replace("_", " ")})
    return data


def _observed(problem: Problem) -> xr.Dataset:
    data = xr.Dataset()
    for measurement in problem.measurements:
        data = _described(data, measurement)
        data[measurement.name] = ((_datum(measurement),), np.asarray(measurement.measured), {"units": measurement.unit})
    return data


def _datum(measurement: Measurement) -> str:
    return f"{measurement.name}_datum"


def _described(data: xr.Dataset, measurement: Measurement) -> xr.Dataset:
    datum = _datum(measurement)
    coordinate = np.asarray(measurement.series.coordinate)
    return data.assign_coords(
        {datum: np.arange(len(coordinate)), f"{measurement.name}_coordinate": (datum, coordinate)}
    )


def _predicted(problem: Problem, points: Float[np.ndarray, "draw n"], key: PRNGKeyArray) -> xr.Dataset:
    """Data as each point would make them, and the means that they scatter about."""

    @jax.jit
    def predict(u: Float[Array, " n"], one: PRNGKeyArray) -> tuple[dict[str, Array], dict[str, Array]]:
        drawn = {each.name: each.measured for each in problem.draw_data(one, u).measurements}
        model = problem.state_of(problem.values(u)).model
        means = {each.name: each.predict(model) for each in problem.measurements}
        return means, {name: jnp.asarray(values) for name, values in drawn.items()}

    # One after the other: a batch of fields and displacements need not fit into memory.
    means, drawn = jax.jit(lambda us, keys: jax.lax.map(lambda pair: predict(*pair), (us, keys)))(
        jnp.asarray(points), jax.random.split(key, len(points))
    )
    told = np.all([np.all(np.isfinite(np.asarray(each)), axis=1) for each in means.values()], axis=0)
    data = xr.Dataset(coords={"chain": np.zeros(1, dtype=int), "draw": np.flatnonzero(told)})
    data.attrs = {"draws_asked": len(points), "draws_left_out": int(np.sum(~told))}
    for measurement in problem.measurements:
        data = _described(data, measurement)
        name, dimensions = measurement.name, ("chain", "draw", _datum(measurement))
        for ending, said, values in (("", "with noise", drawn), ("_mean", "without noise", means)):
            data[f"{name}{ending}"] = (
                dimensions,
                np.asarray(values[name])[told][None],
                {"units": measurement.unit, "long_name": f"{name}, predicted {said}"},
            )
    return data


def _pointwise(problem: Problem, draws: Draws) -> xr.Dataset | None:
    """Log likelihood of each datum given those before it in its series, where no reference ties them together."""
    free = [each for each in problem.measurements if not each.noise.normalised]
    if not free:
        return None

    def terms(u: Float[Array, " n"]) -> dict[str, Array]:
        state = problem.state_of(problem.values(u))
        return {each.name: _terms(state.noise[each.name], each, each.predict(state.model)) for each in free}

    found = jax.jit(lambda us: jax.lax.map(terms, us))(jnp.asarray(draws.flat))
    data = xr.Dataset(coords=_sample_coordinates(draws.log_density.shape))
    for measurement in free:
        data = _described(data, measurement)
        values = np.asarray(found[measurement.name]).reshape(*draws.log_density.shape, -1)
        data[measurement.name] = (
            ("chain", "draw", _datum(measurement)),
            values,
            {
                "units": "1",
                "long_name": f"log likelihood of {measurement.name} [nats], given the data before in a series",
            },
        )
    return data


def _terms(noise: NoiseModel, measurement: Measurement, prediction: Float[Array, " n"]) -> Float[Array, " n"]:
    return noise.terms(jnp.asarray(measurement.measured), prediction, measurement.series)
