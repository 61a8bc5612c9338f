"""Identifiability, profiles and audits: known answers, and the paper's own fits."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import FractionalZener, InputError, complex_modulus, suomi2016
from inverse.datasets.dma import dma_data, group_sweeps
from inverse.inference.audit import Kind, audit
from inverse.inference.dma import dma_problem
from inverse.inference.fit import fit, judge
from inverse.inference.identifiability import identify
from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, Varying, parameter
from inverse.inference.problem import Measurement, Problem
from inverse.inference.profile import Stop, profile
from inverse.parameters import Parameter
from inverse.priors import LogNormal, Normal
from inverse.reproduction.moduli import modulus_magnitude
from inverse.reproduction.zener_table import fitted_frequencies
from inverse.transforms import Interval, Positive

FREQUENCY = np.geomspace(0.1, 100.0, 16)


def sweeps_of(constants: tuple[float, float, float, float], *, phase: bool = True):
    modulus = np.asarray(complex_modulus(FractionalZener(*constants), 2.0 * np.pi * FREQUENCY))
    observed = np.stack([modulus.real, modulus.imag], axis=1) if phase else np.abs(modulus)
    return group_sweeps(dma_data(FREQUENCY, np.full(len(FREQUENCY), 37.0), observed))


def powers(exponents, *, noise: float = 0.01, count: int = 6) -> Problem:
    """Data that are a product of powers of a and b: only that product is determined."""
    entries = tuple(parameter(name, f"model.{name}", "Pa", transform=Positive()) for name in ("a", "b"))
    measured = Measurement(
        "product",
        lambda model: jnp.log(model["a"] ** exponents[0] * model["b"] ** exponents[1]) + jnp.zeros(count),
        jnp.zeros(count),
        unordered(count),
        NoiseModel(additive=noise),
    )
    return Problem(ParameterSet(entries), {"a": 1.0, "b": 1.0}, (measured,))


@pytest.mark.parametrize(("exponents", "said"), [((2.0, 1.0), "b × a^2"), ((1.0, -0.5), "b / a^2")])
def test_a_product_of_powers_is_found(exponents, said):
    """Of six data with deviation s the product's logarithm is known to s / sqrt(6) over the power of b."""
    found = identify(powers(exponents), np.ones(2))
    (combination,) = found.combinations
    assert found.rank == 1 and combination.text in (said, "a × b^0.5", "a / b^0.5")
    one = combination.powers["a"] / exponents[0]
    np.testing.assert_allclose(combination.powers["b"] / exponents[1], one, rtol=1e-8)
    np.testing.assert_allclose(combination.relative_error, 0.01 / np.sqrt(6.0) * abs(one), rtol=1e-8)


def test_an_exponent_that_is_a_constant_of_the_fit_gets_its_name():
    """Far below the relaxation, M - M_0 is the branch modulus times (i omega tau)^alpha and nothing else."""
    constants = (100.0, 1e6 + 100.0, 1e-12, 0.3)
    problem = dma_problem(sweeps_of(constants), estimate_noise=False, with_priors=False)
    found = identify(problem, np.array([100.0, 1e6, 1e-12, 0.3]))
    (combination,) = found.combinations
    assert combination.text == "branch_modulus × relaxation_time^fractional_order"
    assert "Only a combination is determined by these data" in found.sentences[0]


def test_nothing_to_say_of_data_that_determine_all():
    problem = dma_problem(sweeps_of((2e3, 9e3, 0.08, 0.6)), estimate_noise=False, with_priors=False)
    found = identify(problem, np.array([2e3, 7e3, 0.08, 0.6]))
    assert found.rank == 4 and found.sentences == () and np.isfinite(found.condition_number)


def test_profile_of_a_straight_line_is_the_normal_interval():
    x = np.linspace(-1.0, 2.0, 12)
    data = 1.0 + 0.5 * x + 0.1 * np.sin(9.0 * x)
    entries = (parameter("offset", "model.offset", "m"), parameter("slope", "model.slope", "m"))
    measured = Measurement(
        "line",
        lambda model: model["offset"] + model["slope"] * jnp.asarray(x),
        jnp.asarray(data),
        unordered(12),
        NoiseModel(additive=0.2),
    )
    found = fit(Problem(ParameterSet(entries), {"offset": 0.0, "slope": 0.0}, (measured,)), n_starts=2)
    for place, name in enumerate(("offset", "slope")):
        line = profile(found, name, level=0.9)
        half = 1.6448536 * found.uncertainty.standard_errors[place]
        np.testing.assert_allclose(line.interval, found.values[place] + half * np.array([-1.0, 1.0]), atol=2e-3 * half)
        assert line.is_closed and line.warnings == () and np.all(np.diff(line.values) > 0.0)
    # Of a fit whose cost is not the lowest the minimum was missed, and no interval about it means anything.
    missed = profile(dataclasses.replace(found, cost=found.cost + 1.0), "slope")
    assert missed.stops == (Stop.LOWER_MINIMUM, Stop.LOWER_MINIMUM) and not missed.is_closed
    said = "side found a lower cost than the fit: fit again from more starts."
    assert missed.warnings == (f"Profile of slope: the lower {said}", f"Profile of slope: the upper {said}")
    with pytest.raises(InputError, match="must lie between 0 and 1, such as 0.95, got 95"):
        profile(found, "slope", level=95.0)


@pytest.mark.parametrize(("noise", "open_ones"), [(0.5, ["a"]), (0.05, [])])
def test_a_range_is_determined_if_the_data_know_it_better(noise, open_ones):
    """Of a value with a normal prior of 0.1, and of one between -2 and 2, from nine data of each."""
    entries = (
        parameter("a", "model.a", "m", Normal(0.0, 0.1)),
        parameter("b", "model.b", "m", transform=Interval(-2.0, 2.0)),
    )
    measured = Measurement(
        "both",
        lambda model: jnp.stack([model["a"], model["b"]])[jnp.asarray([0] * 9 + [1] * 9)],
        jnp.zeros(18),
        unordered(18),
        NoiseModel(additive=noise),
    )
    found = identify(Problem(ParameterSet(entries), {"a": 0.0, "b": 0.0}, (measured,)), np.zeros(2))
    assert [sentence.split(" is not determined")[0] for sentence in found.sentences] == open_ones
    deviation = noise / 3.0
    np.testing.assert_allclose(found.eigenvalues, [(4.0 / deviation) ** 2, (0.1 / deviation) ** 2], rtol=1e-8)
    np.testing.assert_allclose(found.condition_number, 1600.0, rtol=1e-8)


def test_profile_says_that_there_is_no_limit():
    """A relaxed modulus that no datum feels: its profile rises on no more than one side."""
    constants = (1.0, 1e6, 1e3, 0.5)
    found = fit(dma_problem(sweeps_of(constants), estimate_noise=False, with_priors=False), n_starts=4)
    line = profile(found, "relaxed_modulus")
    assert line.stops[0] in (Stop.FLAT, Stop.BOUND) and line.stops[1] is Stop.CROSSED


@pytest.mark.parametrize("temperature", [50.0, 65.0, 80.0])
def test_the_papers_relaxed_moduli_are_found_out(temperature):
    """Rows that sit at 8 Pa: no minimum, a vanishing score, a modulus that magnitudes do not determine there."""
    row = suomi2016.TABLE_2_ZENER[temperature]
    frequency = fitted_frequencies(row)
    magnitude = np.asarray(modulus_magnitude(suomi2016.TABLE_2_FRACTIONAL_ZENER[temperature], frequency))
    sweeps = group_sweeps(dma_data(frequency, np.full(len(frequency), temperature), magnitude))
    problem = dma_problem(sweeps, fractional=False, with_priors=False, estimate_noise=False)
    branch = 1e3 * row.unrelaxed_modulus_kpa - row.relaxed_modulus_pa
    printed = audit(judge(problem, np.array([row.relaxed_modulus_pa, branch, row.relaxation_time])))
    assert printed.of(Kind.VANISHING_SCORE)[0].parameters == ("relaxed_modulus",)
    assert printed.of(Kind.CONVERGENCE) and "relaxed_modulus is not determined" in printed.identification.sentences[0]
    fitted = fit(problem)
    assert audit(fitted).is_sound and fitted.values[0] > 100.0 * row.relaxed_modulus_pa


def test_a_phase_makes_the_score_whole():
    """At the same constants, data with a phase feel the relaxed modulus to first order."""
    constants = (8.0, 15e3, 0.462, 1.0)
    values = np.array([8.0, 15e3 - 8.0, 0.462])
    for phase in (False, True):
        sweeps = sweeps_of(constants, phase=phase)
        problem = dma_problem(sweeps, fractional=False, with_priors=False, estimate_noise=False)
        assert bool(audit(judge(problem, values)).of(Kind.VANISHING_SCORE)) is not phase


def test_few_starts_that_agree_are_told():
    problem = dma_problem(sweeps_of((2e3, 9e3, 0.08, 0.6)), estimate_noise=False, with_priors=False)
    alone = fit(problem, n_starts=1)
    lonely = audit(alone)
    assert lonely.of(Kind.STARTS) and not lonely.is_minimum
    four = jax.tree.map(lambda each: jnp.repeat(jnp.asarray(each), 4, axis=0), alone.starts)
    apart = dataclasses.replace(alone, starts=dataclasses.replace(four, costs=four.costs + jnp.arange(4.0)))
    assert audit(apart).of(Kind.STARTS)[0].sentence.endswith("a lower one: allow more starts.")
    at_most = audit(apart, may_have_more_starts=False)
    assert at_most.of(Kind.STARTS)[0].sentence.endswith("a lower one: try another seed.")


def test_an_end_of_a_range_is_told():
    """Of a constant above zero the lower one is zero, which the data then do not rule out."""
    problem = dma_problem(sweeps_of((2e3, 9e3, 0.08, 0.6)), estimate_noise=False, with_priors=False)
    found = dataclasses.replace(fit(problem, n_starts=1), ends=("lower", "upper", None, "lower"))
    said = [each.sentence for each in audit(found).of(Kind.BOUND)]
    assert [each.split(":")[0] for each in said] == [
        "relaxed_modulus lies at zero, with which the data are compatible",
        "branch_modulus lies at the upper end of its range",
        "fractional_order lies at the lower end of its range",
    ]


def test_of_a_population_the_groups_are_asked_about():
    """Data of one group alone: the other's value is what is not determined, the population and its spread are not."""
    groups = Varying(
        Parameter("size", "m", Positive(), "size", LogNormal(1.0, 1.0), "model.sizes[{group}]"), ("a", "b"), "sample"
    )
    measured = Measurement(
        "of_a",
        lambda model: jnp.log(model["sizes"][0]) + jnp.zeros(6),
        jnp.zeros(6),
        unordered(6),
        NoiseModel(additive=0.01),
    )
    problem = Problem(ParameterSet((groups,)), {"sizes": (1.0, 1.0)}, (measured,))
    found = identify(problem, np.array([1.0, 0.3, 1.0, 1.0]))
    assert found.names == ("size_population", "size_spread", "size[a]", "size[b]")
    assert found.rank == 1 and found.sentences == (
        "size[b] is not determined by these data: it can change by more than a factor of e, or of its whole range.",
    )
    # All of the information is on the first group: 6 data of a hundredth each.
    np.testing.assert_allclose(np.abs(found.directions[0]), [0.0, 0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.eigenvalues, [6.0 / 0.01**2, 0.0], rtol=1e-10)
    assert np.isinf(found.condition_number)


def test_an_audit_of_what_has_no_value_near_zero():
    """A model that covers no small values says nothing of its score there; one that does tells a square."""

    def problem(covered_from: float) -> Problem:
        size = parameter("size", "model.size", "m", transform=Positive(1.0))
        measured = Measurement(
            "square",
            lambda model: jnp.where(model["size"] >= covered_from, model["size"] ** 2, jnp.nan) + jnp.zeros(5),
            jnp.full(5, 0.01),
            unordered(5),
            NoiseModel(additive=0.1),
        )
        return Problem(ParameterSet((size,)), {"size": 0.5}, (measured,))

    told, silent = (audit(judge(problem(edge), np.array([0.1]))) for edge in (0.0, 0.05))
    assert told.of(Kind.VANISHING_SCORE)[0].parameters == ("size",)
    assert not silent.of(Kind.VANISHING_SCORE)
    assert np.isfinite(silent.identification.eigenvalues).all()
