"""Constants that differ from sonication to sonication: where they stand, and what one value for all would hide."""

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import InputError, discretise, read_experiment
from benchmarks.calibration_cases import SMALL
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.fast_hmi import FastHmi
from inverse.hmi_model import plan_sweeps, predict, sweeps_of_each
from inverse.hmi_problem import FastPrediction, HmiProblem, _one_of_each, hmi_problem
from inverse.inference.audit import audit
from inverse.inference.dma import of_liver
from inverse.inference.experiment import (
    ParameterSection,
    PriorSection,
    anchored,
    free_parameters,
    inference_settings,
    population,
)
from inverse.inference.fit import fit
from inverse.inference.noise import NoiseModel, unordered
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem, State
from inverse.inference.sonications import across_sonications
from inverse.inference.widened import widened
from inverse.priors import LogNormal, Normal
from inverse.sampling import laplace, sample_importance
from inverse.sampling.diagnostics import values_of

DESCRIBED = read_experiment(shipped("suomi2016_experiment"))
SETTINGS = inference_settings(DESCRIBED, "suomi2016_experiment")
MODEL = anchored(DESCRIBED.model(), SETTINGS)
NOISE = {"hmi": NoiseModel(relative=0.02)}
LABELS = ("a", "b", "c")


def differing(*names: str, **changes):
    return SETTINGS.model_copy(update={"across_sonications": names, **changes})


def test_each_sonication_has_its_own_and_all_share_the_rest():
    parameters, root = population(differing("lesion_stiffness"), MODEL, NOISE, LABELS)
    names, state = parameters.names, State(root, NOISE)
    values = np.array(parameters.values(parameters.start(state)))
    stiffness = float(MODEL.lesion.viscoelasticity.branch_modulus.value)
    for factor, label in zip((1.0, 2.0, 3.0), LABELS, strict=True):
        values[names.index(f"lesion_stiffness[{label}]")] = factor * stiffness
    values[names.index("liver_stiffness")] *= 1.5
    models = parameters.write(state, jnp.asarray(values)).model.models
    for factor, model in zip((1.0, 2.0, 3.0), models, strict=True):
        np.testing.assert_allclose(model.lesion.viscoelasticity.branch_modulus.value, factor * stiffness, rtol=1e-12)
        expected = 1.5 * float(MODEL.liver.viscoelasticity.branch_modulus.value)
        np.testing.assert_allclose(model.liver.viscoelasticity.branch_modulus.value, expected, rtol=1e-12)


def test_constants_with_a_normal_prior_may_differ_by_a_share_of_its_deviation():
    """Their spread is in their own unit: half a pascal would have held all sonications together."""
    place = "model.liver.viscoelasticity.branch_modulus.value"
    for prior, scale in ((Normal(5e3, 400.0), 200.0), (LogNormal(5e3, 0.4), 0.5)):
        parameters = ParameterSet((parameter("liver_stiffness", place, "Pa", prior),))
        spread, _ = across_sonications(parameters, MODEL, ["liver_stiffness"], LABELS, spread=0.5)
        (entry,) = spread.entries
        assert entry.spread.sd == scale


def test_the_sample_of_sweeps_is_a_member_of_the_livers_population_only():
    noise = {**NOISE, "dma": NoiseModel(additive=0.01)}
    parameters, root = population(differing("liver_stiffness", "lesion_stiffness"), MODEL, noise, LABELS)
    state, names = State(root, noise), parameters.names
    assert "liver_stiffness[sample of DMA]" in names and "lesion_stiffness[sample of DMA]" not in names
    values = np.array(parameters.values(parameters.start(state)))
    values[names.index("liver_stiffness[sample of DMA]")] = 7e3
    changed = parameters.write(state, jnp.asarray(values)).model
    found, before = (of_liver(each, 0, 37.0) for each in (changed, MODEL))
    np.testing.assert_allclose(found.unrelaxed_modulus - found.relaxed_modulus, 7e3, rtol=1e-12)
    for model in changed.models:
        np.testing.assert_allclose(
            model.liver.viscoelasticity(37.0).unrelaxed_modulus, before.unrelaxed_modulus, rtol=1e-12
        )


def test_wider_populations_scatter_more():
    parameters, _ = population(differing("lesion_stiffness", population_spread=0.3), MODEL, NOISE, LABELS)
    keys = jax.random.split(jax.random.key(0), 4000)
    column = parameters.names.index("lesion_stiffness[b]")
    scatter = []
    for each in (parameters, widened(parameters, 2.0)):
        drawn = jax.vmap(lambda key, each=each: each.values(each.draw(key)))(keys)[:, column]
        scatter.append(np.std(np.log(drawn)))
    # The prior of the middle is half a unit wide, the spread's mean square that of its half-normal prior.
    np.testing.assert_allclose(scatter[0], np.hypot(0.5, 0.3), rtol=0.06)
    np.testing.assert_allclose(scatter[1], 2.0 * scatter[0], rtol=0.06)


class Part(FastHmi):
    """In place of a fast model: the lesion's stiffness in its rows, and how far its logarithm is off the model's."""

    curve: None = None  # type: ignore[assignment]
    sweeps: tuple = ()
    rows: tuple[int, ...] = eqx.field(static=True, default=())

    def predict(self, model, *, n_rows, in_percent):
        return jnp.zeros(n_rows).at[jnp.asarray(self.rows)].set(model.lesion.viscoelasticity.branch_modulus.value)

    def excess(self, model):
        now = model.lesion.viscoelasticity.branch_modulus.value
        return jnp.abs(jnp.log(now / MODEL.lesion.viscoelasticity.branch_modulus.value))


def test_each_sonication_is_predicted_by_its_own_part_and_covered_if_all_are():
    parameters, root = population(differing("lesion_stiffness"), MODEL, NOISE, LABELS)
    names, state = parameters.names, State(root, NOISE)
    values, stiffness = np.array(parameters.values(parameters.start(state))), 5e4
    factors = np.exp([0.1, -0.7, 0.3])
    standing = float(MODEL.lesion.viscoelasticity.branch_modulus.value)
    for factor, label in zip(factors, LABELS, strict=True):
        values[names.index(f"lesion_stiffness[{label}]")] = factor * standing
    model = parameters.write(state, jnp.asarray(values)).model
    apart = FastPrediction((Part(rows=(0, 3)), Part(rows=(1,)), Part(rows=(2, 4))), 5, True)
    np.testing.assert_allclose(apart(model), standing * factors[[0, 1, 2, 0, 2]], rtol=1e-12)
    np.testing.assert_allclose(apart.excess(model), 0.7, rtol=1e-9)
    together = FastPrediction((Part(rows=(0, 1, 2)),), 3, True)
    softer = eqx.tree_at(lambda m: m.lesion.viscoelasticity.branch_modulus.value, MODEL, stiffness)
    np.testing.assert_allclose(together(softer), stiffness)


def test_draws_at_the_edge_of_what_is_covered_are_counted():
    """Of points that are the logarithm of a constant over the model's own, two of five."""
    one = section("lesion_stiffness", "model.lesion.viscoelasticity.branch_modulus.value", 0.5)
    free = free_parameters(differing(parameters=(one,)), MODEL, {})
    prediction = FastPrediction((Part(rows=(0,)),), 1, True)
    measured = Measurement("hmi", prediction, np.zeros(1), unordered(1), NoiseModel(additive=1.0))
    made = HmiProblem(Problem(free, MODEL, (measured,)), prediction, discretise(DESCRIBED.model(), refinement=0.4))
    assert made.near_edge(np.array([[0.0], [0.96], [-0.98], [1.5], [-0.5]])) == pytest.approx(0.4)


def test_of_every_draw_one_sonication_is_learnt_in_turn():
    """The first of the first, the second of the second, and so on, each as often as the others."""
    parameters, root = population(differing("lesion_stiffness"), MODEL, NOISE, LABELS)
    state, names = State(root, NOISE), parameters.names
    values = np.array(parameters.values(parameters.start(state)))
    for number, label in enumerate(LABELS):
        values[names.index(f"lesion_stiffness[{label}]")] = 1e4 * (1.0 + number)
    draw = parameters.write(state, jnp.asarray(values)).model
    learnt = _one_of_each([draw] * 5)
    found = [float(model.lesion.viscoelasticity.branch_modulus.value) for model in learnt]
    np.testing.assert_allclose(found, [1e4, 2e4, 3e4, 1e4, 2e4], rtol=1e-12)
    assert _one_of_each([MODEL, MODEL]) == [MODEL, MODEL]


@pytest.mark.parametrize(
    ("names", "labels", "said"),
    [
        (("lesion_stiffness",), ("a",), "in data of 1: give two or more"),
        (("lesion_stifness",), LABELS, "no parameter is called `lesion_stifness`"),
        (("noise",), LABELS, "`noise` is not one constant of the model"),
    ],
)
def test_what_cannot_differ_is_refused(names, labels, said):
    with pytest.raises(InputError, match=said):
        population(differing(*names), MODEL, NOISE, labels)


TEMPERATURES = np.array([37.0, 50.0, 58.0, 64.0, 70.0])
SPREAD = 0.6
"""Standard deviation of the logarithm of the lesions' stiffness, of which five are drawn evenly."""
FACTORS = np.exp(SPREAD * np.array([-1.28, -0.52, 0.0, 0.52, 1.28]) * 1.09)
DEVIATION = 0.01


def section(name: str, place: str, log_sd: float) -> ParameterSection:
    return ParameterSection(name=name, place=place, unit="Pa", prior=PriorSection(kind="log-normal", log_sd=log_sd))


FREE = (
    section("attenuation", "model.liver.attenuation.values[3]", 0.35),
    section("lesion_stiffness", "model.lesion.viscoelasticity.branch_modulus.value", 0.7),
)


@pytest.fixture(scope="module")
def coarse():
    settings = discretise(DESCRIBED.model(), refinement=0.5)
    return dataclasses.replace(settings, n_heat_steps=SMALL.n_heat_steps, n_push_steps=SMALL.n_push_steps)


@pytest.fixture(scope="module")
def curves(coarse):
    """A sonication a lesion, by the full model, in percent of a reading that scatters as the others do."""
    labels = tuple(str(number) for number in range(len(FACTORS)) for _ in TEMPERATURES)
    temperature = np.tile(TEMPERATURES, len(FACTORS))
    blank = HmiData(Path("simulated"), labels, temperature, None, np.full(len(labels), 100.0), True, None, ())
    plan = plan_sweeps(blank, DESCRIBED.stepwise(), SETTINGS.reference_temperature_c)
    free = free_parameters(differing(parameters=FREE), MODEL, {})
    state, random = State(MODEL, {}), np.random.default_rng(4)
    standing = np.array(free.values(free.start(state)))
    shown = jax.jit(lambda model: predict(model, plan, coarse, n_rows=len(labels), in_percent=True))
    curve = np.zeros(len(labels))
    for label, factor in enumerate(FACTORS):
        rows = blank.rows_of(str(label))
        model = free.write(state, jnp.asarray(standing * [1.0, factor])).model
        curve[rows] = np.asarray(shown(jax.tree.map(jnp.asarray, model)))[rows]
    noisy = curve * (1.0 + DEVIATION * random.standard_normal(len(labels)))
    at_reference = temperature == SETTINGS.reference_temperature_c
    for label in blank.labels:
        noisy[blank.rows_of(label)] *= 1.0 - DEVIATION * random.standard_normal()
    noisy[at_reference] = 100.0
    return dataclasses.replace(blank, displacement=noisy, sd=DEVIATION * curve)


def made(curves, coarse, settings):
    return hmi_problem(
        DESCRIBED, settings, curves, focus=False, effort=SMALL, discretisation=coarse, heat_settings=coarse
    )


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_spread_between_sonications_is_found_and_one_value_for_all_is_too_sure(curves, coarse):
    apart = made(curves, coarse, differing("lesion_stiffness", parameters=FREE))
    names = apart.problem.parameters.names
    # Every sonication's rows by its own model.
    values = jnp.asarray(apart.problem.values(apart.problem.start))
    checked = apart.verify(np.asarray(apart.problem.start)[None])
    assert np.all(checked.covered) and checked.largest_error < 0.02
    alone = values.at[names.index("lesion_stiffness[3]")].multiply(1.2)
    change = np.asarray(apart.prediction(apart.problem.state_of(alone).model)) - checked.fast[0]
    assert set(np.flatnonzero(np.abs(change) > 1e-9)) <= set(curves.rows_of("3")) and np.max(np.abs(change)) > 0.1
    normal = laplace(apart.problem, n_starts=2)
    assert normal.converged and normal.positive_definite
    drawn = sample_importance(apart.problem, normal, seed=0, draws=500, evaluations=3000, chunk=20)
    sampled = values_of(apart.problem, drawn).reshape(-1, len(names))
    low, high = np.quantile(sampled[:, names.index("lesion_stiffness_spread")], [0.02, 0.98])
    assert 0.1 < low < SPREAD < high
    standing = float(MODEL.lesion.viscoelasticity.branch_modulus.value)
    for label, factor in enumerate(FACTORS):
        one = np.log(sampled[:, names.index(f"lesion_stiffness[{label}]")] / (factor * standing))
        assert abs(np.mean(one)) < 4.0 * np.std(one)

    pooled = made(curves, coarse, differing(parameters=FREE))
    found = fit(pooled.problem, n_starts=2)
    assert found.converged and audit(found).n_starts == 2
    # The pooled fit leaves many deviations more, and is surer of its one value than the population is of its middle.
    together = fit(apart.problem, n_starts=2)
    assert together.converged and found.cost - together.cost > 10.0
    place = found.problem.parameters.names.index("lesion_stiffness")
    sure = found.uncertainty.standard_errors[place] / found.values[place]
    honest = np.std(np.log(sampled[:, names.index("lesion_stiffness_population")]))
    assert honest > 2.0 * sure
    # Of five lesions it covers one or none.
    inside = np.abs(np.log(found.values[place] / (FACTORS * standing))) < 2.0 * sure
    assert np.sum(inside) <= 1


def test_sweeps_are_taken_apart_by_sonication():
    temperature = np.array([45.0, 70.0, 50.0, 70.0, 60.0])
    data = HmiData(Path("none"), ("x", "x", "y", "y", "z"), temperature, None, np.full(5, 99.0), True, None, ())
    plan = plan_sweeps(data, DESCRIBED.stepwise(), 37.0)
    each = sweeps_of_each(plan, data)
    assert [len(sweeps) for sweeps in each] == [1, 1, 1]
    for sweeps, rows in zip(each, ([0, 1], [2, 3], [4]), strict=True):
        np.testing.assert_array_equal(sweeps[0].rows, rows)
        np.testing.assert_array_equal(sweeps[0].states[sweeps[0].places], temperature[rows])
        assert sweeps[0].protocol in [sweep.protocol for sweep in plan]
