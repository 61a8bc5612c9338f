"""Parameters together: the flat vector, its prior, populations of samples, choice by name."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from arfjax import InputError
from inverse.inference.dma import Samples, ZenerConstants
from inverse.inference.parameter_set import ParameterSet, Varying, parameter
from inverse.inference.problem import Problem
from inverse.parameters import Parameter
from inverse.priors import Dirichlet, HalfNormal, LogNormal, Normal, Uniform
from inverse.transforms import Positive, Simplex

SAMPLES = Samples(tuple(ZenerConstants(1e3 * k, 5e3, 0.1, 0.4) for k in (1.0, 2.0, 4.0)))
LABELS = ("a", "b", "c")


def population() -> Varying:
    prior = LogNormal(1e3, 1.0)
    middle = Parameter("relaxed_modulus", "Pa", prior.transform, "", prior, "solids[{group}].relaxed_modulus")
    return Varying(middle, LABELS, "sample", HalfNormal(0.7))


def together() -> ParameterSet:
    order = parameter("order", "solids[0].fractional_order", "1", Uniform(0.0, 1.0))
    time = parameter("time_factor", "solids[1].relaxation_time", "1", LogNormal(1.0, 0.2), relative=True)
    return ParameterSet((order, population(), time))


def test_what_stands_in_the_tree_is_the_start():
    parameters = together()
    values = parameters.values(parameters.start(SAMPLES))
    names = dict(zip(parameters.names, values, strict=True))
    assert parameters.size == 7 and len(parameters.beliefs) == 7
    np.testing.assert_allclose([names[f"relaxed_modulus[{label}]"] for label in LABELS], [1e3, 2e3, 4e3], rtol=1e-12)
    np.testing.assert_allclose(names["relaxed_modulus_population"], 2e3, rtol=1e-12)
    np.testing.assert_allclose([names["order"], names["time_factor"]], [0.4, 1.0], rtol=1e-12)
    again = parameters.write(SAMPLES, values)
    assert jax.tree.all(jax.tree.map(lambda a, b: bool(np.isclose(a, b, rtol=1e-12)), again, SAMPLES))


def test_a_factor_multiplies():
    parameters = together().only(["time_factor"])
    changed = parameters.write(SAMPLES, jnp.asarray([3.0]))
    np.testing.assert_allclose(changed.solids[1].relaxation_time, 0.3)


def test_prior_of_a_population_is_that_of_its_parts():
    """Middle and spread by their densities with the derivative of the exponential, groups standard normal."""
    u = jnp.asarray([0.3, -0.4, 0.5, -1.0, 0.2])
    spread = 0.7 * np.exp(-0.4)
    expected = stats.norm.logpdf(0.3, 0.0, 1.0) + stats.halfnorm.logpdf(spread, scale=0.7) + np.log(spread)
    expected += stats.norm.logpdf(np.asarray(u[2:])).sum()
    np.testing.assert_allclose(population().log_prior(u), expected, rtol=1e-12)
    values = population().values(u)
    np.testing.assert_allclose(values[2:], 1e3 * np.exp(0.3 + spread * np.asarray(u[2:])), rtol=1e-12)


def test_draws_from_the_prior_scatter_as_the_population_says():
    keys = jax.random.split(jax.random.key(2), 20_000)
    u = jax.vmap(population().draw)(keys)
    coordinate = np.log(np.asarray(jax.vmap(population().values)(u))[:, 2:] / 1e3)
    # Variance of the middle plus mean square of the half-normal spread; and the middle's alone between two groups.
    np.testing.assert_allclose(coordinate.var(axis=0), 1.0 + 0.7**2, rtol=0.08)
    np.testing.assert_allclose(np.cov(coordinate.T)[0, 1], 1.0, rtol=0.08)


def test_shares_among_parameters():
    prior = Dirichlet(jnp.ones(3))
    shares = parameter("weights", "weights", "1", prior)
    tree = {"weights": jnp.asarray([0.2, 0.3, 0.5]), "scale": 2.0}
    parameters = ParameterSet((shares, parameter("scale", "scale", "Pa", Normal(0.0, 1.0))))
    assert parameters.size == 3 and parameters.names == ("weights[0]", "weights[1]", "weights[2]", "scale")
    values = parameters.values(parameters.start(tree))
    np.testing.assert_allclose(values, [0.2, 0.3, 0.5, 2.0], rtol=1e-12)
    assert isinstance(shares.parameter.transform, Simplex) and not parameters.is_plain
    np.testing.assert_allclose(parameters.write(tree, values)["weights"], tree["weights"], rtol=1e-12)


def test_choice_by_name():
    parameters = together()
    assert parameters.only(["order"]).names == ("order",)
    assert parameters.without(["relaxed_modulus"]).names == ("order", "time_factor")
    with pytest.raises(InputError, match="no parameter is called `ordr`; there are order, relaxed_modulus, time_fac"):
        parameters.only(["ordr"])
    with pytest.raises(InputError, match="two parameters are called `order`"):
        ParameterSet((parameters.entries[0], parameters.entries[0]))
    twice = Varying(population().parameter, ("a", "a"), "sample", HalfNormal(0.7))
    with pytest.raises(InputError, match=r"two parameters are called `relaxed_modulus\[a\]`"):
        ParameterSet((twice,))


def test_a_parameter_without_prior_cannot_be_drawn():
    bare = ParameterSet((parameter("scale", "scale", "Pa", transform=Positive()),))
    assert not bare.has_priors
    with pytest.raises(InputError, match="`scale` has no prior"):
        bare.draw(jax.random.key(0))


def test_two_parameters_in_one_place_are_refused():
    """The second would overwrite the first, which the data then could not tell of."""
    order = [parameter(name, "solids[0].fractional_order", "1", Uniform(0.0, 1.0)) for name in ("order", "alpha")]
    with pytest.raises(InputError, match=r"`order` and `alpha` have the same place, `solids\[0\].fractional_order`"):
        ParameterSet(tuple(order))
    by_hand = [parameter(name, "", "1", Uniform(0.0, 1.0)) for name in ("order", "alpha")]
    assert ParameterSet(tuple(by_hand)).names == ("order", "alpha")


@pytest.mark.parametrize(
    "second",
    [
        parameter("offset", "model.solids[-3].relaxed_modulus", "Pa", LogNormal(1e3, 1.0)),
        Varying(
            Parameter("offset", "Pa", Positive(), "", LogNormal(1e3, 1.0), "model.solids[{group}].relaxed_modulus"),
            LABELS,
            "sample",
        ),
    ],
)
def test_a_place_that_is_written_in_another_way_is_the_same(second):
    first = parameter("relaxed_modulus", "model.solids[0].relaxed_modulus", "Pa", LogNormal(1e3, 1.0))
    said = r"`relaxed_modulus` and `offset` have the same place, `model\.solids\[0\]\.relaxed_modulus`"
    with pytest.raises(InputError, match=said):
        Problem(ParameterSet((first, second)), SAMPLES, ())
