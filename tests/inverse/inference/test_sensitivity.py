"""Sensitivities with known answers: products of powers, and Ishigami's function."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import (
    InputError,
    discretise,
    read_experiment,
    simulate_heating,
    stepwise_displacement,
    suomi2016,
    tabulated_size,
)
from inverse.datasets.shipped import shipped
from inverse.inference import places
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.sensitivity import local_sensitivity, one_at_a_time, sobol_sensitivity
from inverse.priors import Uniform
from inverse.transforms import Positive

MODEL = {"a": 2.0, "b": 3.0, "c": 0.5}


def constants(prior=None) -> ParameterSet:
    transform = Positive() if prior is None else None
    return ParameterSet(tuple(parameter(k, f"model.{k}", "1", prior, transform=transform) for k in MODEL))


def power(model) -> jnp.ndarray:
    return jnp.stack([model["a"] ** 2 / model["b"], 5.0 * model["c"]])


def test_elasticities_of_powers_are_the_powers():
    found = local_sensitivity(constants(), MODEL, power)
    np.testing.assert_allclose(found.elasticity, [[2.0, -1.0, 0.0], [0.0, 0.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(found.result, [4.0 / 3.0, 2.5], rtol=1e-14)


def test_one_at_a_time_changes_one_at_a_time():
    found = one_at_a_time(constants(), MODEL, power, change=0.25)
    assert [(each.name, each.change) for each in found[:2]] == [("a", -0.25), ("a", 0.25)]
    np.testing.assert_allclose(found[1].difference, [4.0 / 3.0 * (1.25**2 - 1.0), 0.0], atol=1e-14)
    np.testing.assert_allclose(found[2].result[0], 4.0 / 3.0 / 0.75, rtol=1e-14)
    with pytest.raises(InputError, match="must be a share between 0 and 1, such as 0.25, got 25"):
        one_at_a_time(constants(), MODEL, power, change=25.0)


def test_shares_of_ishigamis_function():
    """Sobol' indices of sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 in closed form (Saltelli et al. 2000, section 2.9)."""

    def ishigami(model):
        x, y, z = model["a"], model["b"], model["c"]
        return jnp.sin(x) + 7.0 * jnp.sin(y) ** 2 + 0.1 * z**4 * jnp.sin(x)

    found = sobol_sensitivity(constants(Uniform(-np.pi, np.pi)), MODEL, ishigami, n_samples=2048, seed=4)
    first = 0.5 * (1.0 + 0.1 * np.pi**4 / 5.0) ** 2
    second, joint = 49.0 / 8.0, 8.0 * 0.01 * np.pi**8 / 225.0
    variance = first + second + joint
    np.testing.assert_allclose(found.variance, variance, rtol=0.03)
    np.testing.assert_allclose(found.first_order[0], np.array([first, second, 0.0]) / variance, atol=0.03)
    np.testing.assert_allclose(found.total[0], np.array([first + joint, second, joint]) / variance, atol=0.03)
    assert np.all(found.first_order_interval[0] <= found.first_order + 1e-9)
    assert found.n_evaluations == 5 * 2048 and found.seed == 4


def test_impossible_samples_are_refused():
    with pytest.raises(InputError, match="must be a power of 2 such as 256, got 100"):
        sobol_sensitivity(constants(Uniform(0.0, 1.0)), MODEL, power, n_samples=100)
    with pytest.raises(InputError, match="need a prior for every constant"):
        sobol_sensitivity(constants(), MODEL, power, n_samples=4)
    with pytest.raises(InputError, match="not a number"):
        sobol_sensitivity(constants(Uniform(-1.0, 1.0)), MODEL, lambda m: jnp.log(m["a"]), n_samples=4)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_papers_quarter_up_and_down_is_one_call():
    """Its lesion's modulus moves the displacement at 70 degC by about 2 points of that at 35 degC, ours by 2.5."""
    described = read_experiment(shipped("suomi2016_experiment"))
    model = jax.tree.map(jnp.asarray, described.model())
    model = dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, size=tabulated_size()))
    settings, protocol = discretise(model, refinement=2.0), described.stepwise()

    def percent(each):
        heating = simulate_heating(each, protocol, settings)
        pair = stepwise_displacement(each, jnp.asarray([35.0, 70.0]), protocol, settings, heating=heating)
        return 100.0 * pair[1] / pair[0]

    place = "lesion.viscoelasticity.branch_modulus.value"
    stiffness = parameter("lesion_stiffness", f"model.{place}", "Pa", transform=Positive())
    found = one_at_a_time(ParameterSet((stiffness,)), model, percent, change=0.25)
    direct = [float(percent(places.write(model, place, jnp.asarray(k), relative=True))) for k in (0.75, 1.25)]
    np.testing.assert_allclose([each.result[0] for each in found], direct, rtol=1e-9)
    most = max(abs(float(each.difference[0])) for each in found)
    assert most == pytest.approx(suomi2016.TEXT_MODULUS_VARIATION_POINTS, abs=1.0)
    assert found[0].difference[0] > 0.0 > found[1].difference[0]
