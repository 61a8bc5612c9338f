import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension, every_shape
from inverse.diagnosis.dma.cause import predicted_modulus
from inverse.diagnosis.dma.causes.slip import Slip
from inverse.diagnosis.dma.extended_fit import fit_extended
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.noise import noise_family
from inverse.diagnosis.projection import independent, unit_columns, visibility
from inverse.diagnosis.screening import Alternative, Screen
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind

REQUIRED = (
    "instrument-inertia clamp-compliance frame-resonance phase-delay noise-floor slip sweep-drift drying "
    "bath-viscosity temperature-lag second-relaxation power-law-relaxation poroelastic-drainage strain-nonlinearity"
).split()
EVERY = [
    Extension(cause, shape)
    for cause in DMA_CAUSES
    for shape in dict.fromkeys((cause.shapes[0], cause.shapes[len(cause.shapes) // 2], cause.shapes[-1]))
]
IDS = [f"{e.cause.name}-{e.shape}" for e in EVERY]


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dma")
    blind.write(folder / "data.csv", folder / "key.json", seed=1, shuffled=True)
    return read_dma(folder / "data.csv")


@pytest.fixture(scope="module")
def problem(measured):
    return dma_problem(measured, FRACTIONAL)


def test_library_holds_the_names_that_users_write():
    assert [cause.name for cause in DMA_CAUSES] == list(dict.fromkeys(cause.name for cause in DMA_CAUSES))
    assert set(REQUIRED) <= {cause.name for cause in DMA_CAUSES}
    for cause in DMA_CAUSES:
        assert cause.sentence.endswith(".") and cause.helps.endswith(".") and cause.source and cause.unit
        assert cause.plausible > 0.0 and cause.sign in (0, 1) and ":" in cause.place


@pytest.mark.parametrize("extension", EVERY, ids=IDS)
def test_nothing_at_strength_0_and_something_at_a_plausible_one(problem, extension):
    constants = jnp.asarray(problem.constants).at[:, 3].set(0.6)
    plain = predicted_modulus(constants, problem.conditions)
    null = predicted_modulus(constants, problem.conditions, (extension,), jnp.zeros(1))
    np.testing.assert_allclose(null, plain, rtol=1e-14)
    changed = predicted_modulus(constants, problem.conditions, (extension,), jnp.array([extension.cause.plausible]))
    # Plausible means: up to a few times the modulus, and more than a thousandth of it somewhere.
    relative = np.abs(np.asarray(changed / plain) - 1.0)
    assert np.all(np.isfinite(relative)) and 1e-3 < relative.max() < 20.0


@pytest.mark.parametrize("extension", EVERY, ids=IDS)
def test_slope_in_the_strength(problem, extension):
    constants = jnp.asarray(problem.constants).at[:, 3].set(0.6)

    def logarithm(strength):
        modulus = predicted_modulus(constants, problem.conditions, (extension,), strength[None])
        return jnp.concatenate([jnp.log(jnp.abs(modulus)), jnp.angle(modulus)])

    at = jnp.asarray(0.05 * extension.cause.plausible)
    step = 1e-5 * extension.cause.plausible
    forward = jax.jvp(logarithm, (at,), (jnp.ones(()),))[1]
    reverse = jax.jacrev(logarithm)(at)
    central = (logarithm(at + step) - logarithm(at - step)) / (2.0 * step)
    largest = float(jnp.max(jnp.abs(forward)))
    np.testing.assert_allclose(reverse, forward, rtol=1e-10, atol=1e-12 * largest)
    np.testing.assert_allclose(forward, central, rtol=1e-6, atol=1e-6 * largest)


def as_the_generator_has_it(problem):
    """Constants of the fit, and when each row was measured."""
    order = [np.argsort(sweep.data.frequency_hz) for sweep in problem.sweeps]
    clock = np.stack([np.asarray(s.data.time_s)[o] for s, o in zip(problem.sweeps, order, strict=True)])
    constants = np.array(problem.constants)
    constants[:, 1] -= constants[:, 0]
    temperature = np.array([s.temperature_c for s in problem.sweeps])
    return blind.Measurement(temperature, problem.sweeps[0].data.frequency_hz, constants, clock)


SHAPED = {"frame-resonance": 1.6, "temperature-lag": 0.35, "second-relaxation": 0.55, "poroelastic-drainage": 0.9}
"""Second parameters as the generator has them, between those that are screened."""


@pytest.mark.parametrize("name", SHAPED)
def test_effect_with_a_second_parameter_is_what_an_independent_code_gives(problem, name):
    """At a plausible strength, with that parameter: a place counted from the other end of the sweep is another one."""
    m = as_the_generator_has_it(problem)
    cause, plain = next(one for one in DMA_CAUSES if one.name == name), blind.solid(m.constants, m.omega)
    theirs = blind.EFFECTS[name](plain, m, cause.plausible)
    # Levels as the model has them, not as they were measured.
    level = np.exp(np.mean(np.log(np.abs(plain)), axis=1))[np.asarray(problem.conditions.sweep)]
    conditions = dataclasses.replace(problem.conditions, level=jnp.asarray(level))
    extension, strength = Extension(cause, SHAPED[name]), jnp.array([cause.plausible])
    ours = predicted_modulus(jnp.asarray(problem.constants), conditions, (extension,), strength)
    np.testing.assert_allclose(ours, theirs.ravel(), rtol=1e-9)


@pytest.mark.parametrize("name", [n for n in blind.EFFECTS if n not in ("frame-resonance", "temperature-lag")])
def test_direction_is_what_an_independent_code_gives(problem, measured, name):
    """On the constants of the fit, with sweeps and rows in the package's order; effects with a shape only roughly."""
    m = as_the_generator_has_it(problem)
    plain, small = blind.solid(m.constants, m.omega), blind.SCALES.get(name, 1e-4)
    theirs = np.log(blind.EFFECTS[name](plain, m, small) / blind.EFFECTS[name](plain, m, -small)) / (2.0 * small)
    theirs = np.stack([theirs.real.ravel(), theirs.imag.ravel()], axis=-1).ravel()
    ours = [a.directions[:, 0] for a in problem.directions(every_shape(c for c in DMA_CAUSES if c.name == name))]
    cosines = [theirs @ one / np.linalg.norm(theirs) / np.linalg.norm(one) for one in ours]
    # Shapes between those of the library are met by the two next to them, but not exactly.
    assert max(cosines) > (0.999 if len(ours) == 1 else 0.95)
    if len(ours) == 1:
        # Levels are of measured moduli here and of modelled ones there: 2 percent of noise apart at most.
        np.testing.assert_allclose(ours[0], theirs, rtol=0.1, atol=0.03 * np.abs(theirs).max())


@pytest.mark.parametrize("name", ["none", "second-relaxation", "poroelastic-drainage"])
def test_what_the_fit_leaves_of_an_effect_turns_little_from_shape_to_shape(tmp_path, name):
    """Else an effect between two shapes looks like neither, and is not seen."""
    blind.write(tmp_path / "data.csv", tmp_path / "key.json", seed=3, name=name, noise="none", d_prime=4.5)
    problem = dma_problem(read_dma(tmp_path / "data.csv"), FRACTIONAL)
    basis = independent(problem.fitted_directions())
    for cause in DMA_CAUSES:
        directions = [a.directions[:, 0] for a in problem.directions(every_shape([cause]))]
        left = unit_columns(np.stack([one - basis @ (basis.T @ one) for one in directions], axis=1))
        cosines = np.sum(left[:, 1:] * left[:, :-1], axis=0)
        assert np.all(cosines > 0.7), cause.name


def test_compliance_in_series_is_imitated_by_the_constants(problem):
    clamp = problem.directions(every_shape(c for c in DMA_CAUSES if c.name == "clamp-compliance"))[0]
    assert visibility(clamp.directions, problem.fitted_directions())[0] < 1e-6


def test_power_law_is_in_the_fractional_model_and_not_in_the_conventional_one(measured, problem):
    cause = every_shape(cause for cause in DMA_CAUSES if cause.name == "power-law-relaxation")
    assert visibility(problem.directions(cause)[0].directions, problem.fitted_directions())[0] < 1e-6
    zener = dma_problem(measured, CONVENTIONAL)
    assert visibility(zener.directions(cause)[0].directions, zener.fitted_directions())[0] > 0.1


def test_a_strength_stays_within_what_it_can_be(tmp_path):
    """Beyond the largest an order or a modulus would be negative; intervals end there, too."""
    blind.write(tmp_path / "data.csv", tmp_path / "key.json", seed=blind.TEST_SEEDS + 5101, name="slip", d_prime=9.0)
    problem = dma_problem(read_dma(tmp_path / "data.csv"), FRACTIONAL)
    noise = noise_family(problem.orderings(), problem.frequencies())[0]
    free = fit_extended(problem, [Extension(Slip(), 0.0)], noise, np.array([0.1]))
    # The interval of regression on the derivatives there, which are in plausible strengths.
    others = independent(free.directions[:, 1:])
    across = free.directions[:, 0] - others @ (others.T @ free.directions[:, 0])
    freedom = len(free.residuals) - 1 - others.shape[1]
    error = Slip.plausible * np.sqrt(np.sum(free.residuals**2) / freedom) / np.linalg.norm(across)
    reach = stats.t.ppf(0.975, freedom) * error
    assert free.intervals[0] == pytest.approx(free.strengths[0] + reach * np.array([-1.0, 1.0]), abs=1e-3 * reach)

    class Little(Slip):
        largest = 0.5 * float(free.strengths[0])

    held = fit_extended(problem, [Extension(Little(), 0.0)], noise, np.array([2.0 * Little.largest]))
    assert held.converged and held.strengths[0] == pytest.approx(Little.largest)
    assert held.intervals[0, 1] == pytest.approx(Little.largest) and held.misfit > free.misfit
    # What it cannot follow any more is there to be found: its own direction is none of those that were fitted.
    assert held.directions.shape[1] == free.directions.shape[1] - 1
    own = Alternative("slip", free.directions[:, :1])
    left = Screen(held.directions, [own], [noise]).statistics(held.residuals[:, None]).statistic[0, 0]
    assert left > 3.0
    assert free.intervals[0, 1] < Slip.largest
    solids = ("power-law-relaxation", "slip", "strain-nonlinearity", "temperature-lag")
    assert all(cause.plausible < cause.largest <= 1.0 for cause in DMA_CAUSES if cause.name in solids)
