"""Samplers against posteriors with known moments; runs that are killed, resumed, or not what they claim."""

import dataclasses
import os
import signal
import subprocess
import sys
import time

import emcee
import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from emcee.backends import HDFBackend
from scipy import stats

from arfjax import InputError
from inverse import study
from inverse.inference.parameter_set import parameter
from inverse.inference.problem import Problem
from inverse.inference.profile import Profile, Stop
from inverse.priors import Normal, Uniform
from inverse.sampling import (
    Diagnostics,
    Evidence,
    StopRule,
    default_walkers,
    diagnose_draws,
    laplace,
    nuts,
    sample_ensemble,
    sample_nuts,
    walkers_from_laplace,
    walkers_from_prior,
)
from inverse.sampling.inference_data import standard_error
from inverse.sampling.target import (
    batched_log_density,
    batched_values,
    coordinate_names,
    fingerprint,
    refuse_other_problem,
)
from tests.inverse.sampling.conjugate import Line, conjugate_problem, exact_posterior

QUICK = {"warmup": 300, "draws": 400, "chunk": 100}


@pytest.fixture(scope="module")
def problem():
    return conjugate_problem()


@pytest.fixture(scope="module")
def found(problem):
    return laplace(problem)


def assert_moments(draws, problem, *, within=4.0):
    """Means, deviations and quantiles within four Monte Carlo standard errors of the exact ones."""
    mean, covariance, _ = exact_posterior(problem)
    for index, sd in enumerate(np.sqrt(np.diag(covariance))):
        one = draws.unconstrained[:, :, index]
        assert abs(one.mean() - mean[index]) < within * standard_error(one, "mean")
        assert abs(one.std() - sd) < within * standard_error(one, "sd")
        low = mean[index] - 1.6448536269514722 * sd
        assert abs(np.quantile(one, 0.05) - low) < within * standard_error(one, "quantile", 0.05)
    correlation, exact = np.corrcoef(draws.flat.T), covariance / np.sqrt(np.outer(*2 * [np.diag(covariance)]))
    np.testing.assert_allclose(correlation, exact, atol=0.1)


def test_laplace_is_exact_for_a_normal_posterior(problem, found):
    mean, covariance, evidence = exact_posterior(problem)
    assert found.converged and found.positive_definite
    assert found.message == "mode reached by 8 of 8 starts"
    np.testing.assert_allclose(found.mode, mean, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8)
    np.testing.assert_allclose(found.log_evidence, evidence, rtol=1e-9)
    drawn = found.draw(jax.random.key(0), 20_000)
    np.testing.assert_allclose(np.cov(drawn.T), covariance, rtol=0.1)


def test_a_mode_is_sound_if_half_of_the_starts_came_to_it(found):
    """Within a tenth of a nat, and only if it is a mode with a covariance."""
    height = found.log_density
    for apart, sound in ((2, True), (3, False)):
        starts = np.array([height, height - 0.09, *np.full(apart, height - 0.2)])
        assert dataclasses.replace(found, starts=starts).is_sound is sound
    assert found.is_sound
    assert not dataclasses.replace(found, converged=False).is_sound
    assert not dataclasses.replace(found, positive_definite=False).is_sound


def test_laplace_says_which_direction_is_flat(problem):
    wide = (
        parameter("tied", "model.coefficients[0]", "m", Normal(0.0, 1e5)),
        parameter("other", "model.coefficients[1]", "m", Normal(0.0, 1e5)),
    )
    twin = np.repeat(np.linspace(-1.0, 1.0, 12)[:, None], 2, axis=1)
    one = conjugate_problem(2)
    measurement = one.measurements[0]
    predict = type(measurement.predict)(twin)
    same = type(measurement)("line", predict, measurement.measured, measurement.series, measurement.noise, "m")
    approximated = laplace(Problem(type(problem.parameters)(wide), Line(jnp.zeros(2)), (same,)), n_starts=2)
    assert not approximated.positive_definite and np.isnan(approximated.log_evidence)
    assert "does not fall along 0.71 tied -0.71 other" in approximated.message.replace(
        "0.71 other -0.71 tied", "0.71 tied -0.71 other"
    )
    assert np.all(np.isfinite(approximated.draw(jax.random.key(0), 3)))


@pytest.mark.slow  # compiling a trajectory takes longest
def test_nuts_has_the_known_moments(problem, found):
    said = []
    draws = sample_nuts(problem, found, seed=1, chains=4, on_step=said.append, **QUICK)
    assert_moments(draws, problem)
    assert draws.divergences == 0 and draws.finished and draws.log_density.shape == (4, 400)
    assert said == ["nuts: warm-up", *(f"nuts: {k} of 400 draws, 0 divergences" for k in (0, 100, 200, 300))]
    values = batched_log_density(problem)(draws.flat)
    np.testing.assert_allclose(draws.log_density.ravel(), values, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("moves", [None, [(emcee.moves.StretchMove(), 1.0)]], ids=["difference", "stretch"])
def test_the_ensemble_has_the_known_moments_and_stops_by_its_rule(problem, found, moves):
    start = walkers_from_laplace(problem, found, count=32)
    said = []
    draws = sample_ensemble(problem, start, seed=1, most_steps=8000, check_every=400, moves=moves, on_step=said.append)
    assert_moments(draws, problem)
    assert draws.finished and draws.message.startswith("stopped by its rule")
    assert draws.settings["steps"] > 50 * draws.settings["autocorrelation_time"]
    assert draws.settings["steps"] % 400 == 0 and len(said) == draws.settings["steps"] // 400
    assert diagnose_draws(problem, draws).complaints == ()


def test_an_ensemble_that_is_too_short_says_so(problem):
    start = walkers_from_prior(problem, count=32)
    draws = sample_ensemble(problem, start, seed=1, most_steps=60, check_every=30)
    assert not draws.finished
    assert "the rule to stop was not met: 60 steps are" in draws.message and "most_steps" in draws.message
    assert any("did not finish" in each for each in diagnose_draws(problem, draws).complaints)


def test_a_resumed_ensemble_is_the_uninterrupted_one(problem, found, tmp_path):
    start = walkers_from_laplace(problem, found, count=16)
    whole = sample_ensemble(problem, start, seed=5, most_steps=200, check_every=50)
    rule = {"seed": 5, "check_every": 50, "file": tmp_path / "run.h5"}
    sample_ensemble(problem, start, most_steps=70, **rule)
    resumed = sample_ensemble(problem, start, most_steps=200, **rule)
    np.testing.assert_array_equal(resumed.unconstrained, whole.unconstrained)
    np.testing.assert_array_equal(resumed.log_density, whole.log_density)
    assert resumed.message == whole.message
    assert resumed.settings == whole.settings and 0.0 < whole.settings["acceptance"] < 1.0
    assert resumed.evaluations == whole.evaluations == 16 * 201
    with pytest.raises(InputError, match="moves"):
        sample_ensemble(problem, start, most_steps=300, moves=[(emcee.moves.StretchMove(), 1.0)], **rule)
    # The file is emcee's own.
    assert HDFBackend(str(tmp_path / "run.h5"), read_only=True).get_chain().shape == (200, 16, 3)


@pytest.mark.slow
def test_resumed_chains_of_nuts_are_the_uninterrupted_ones(problem, found, tmp_path):
    rule = {"seed": 5, "chains": 4, "warmup": 300, "chunk": 100}
    whole = sample_nuts(problem, found, draws=300, **rule)
    sample_nuts(problem, found, draws=100, file=tmp_path / "run.h5", **rule)
    resumed = sample_nuts(problem, found, draws=300, file=tmp_path / "run.h5", **rule)
    np.testing.assert_array_equal(resumed.unconstrained, whole.unconstrained)
    np.testing.assert_array_equal(resumed.statistics["n_steps"], whole.statistics["n_steps"])


def test_a_resumed_chain_goes_on_with_its_own_random_numbers(problem, found, tmp_path):
    """Short enough for every day: twenty draws at once, and ten and ten."""
    rule = {"seed": 5, "warmup": 20, "chunk": 10}
    whole = sample_nuts(problem, found, draws=20, **rule)
    first = sample_nuts(problem, found, draws=10, file=tmp_path / "run.h5", **rule)
    resumed = sample_nuts(problem, found, draws=20, file=tmp_path / "run.h5", **rule)
    np.testing.assert_array_equal(resumed.unconstrained, whole.unconstrained)
    np.testing.assert_array_equal(first.unconstrained, whole.unconstrained[:, :10])
    assert resumed.evaluations == whole.evaluations == np.sum(whole.statistics["n_steps"]) > first.evaluations
    assert resumed.seconds > first.seconds and resumed.settings["draws"] == 20
    # What was drawn is drawn in the coordinates of the problem.
    np.testing.assert_allclose(whole.log_density.ravel(), batched_log_density(problem)(whole.flat), rtol=1e-9)


def test_no_random_number_is_used_twice(problem, found, monkeypatch):
    """Every chunk begins with the number of draws before it, from which its random numbers follow."""
    begun = []

    def advance(numbers, centre, factor, state, keys, first, count, most_doublings):
        begun.append(int(first))
        return state, (np.zeros((2, count, 3)), *np.zeros((6, 2, count)))

    moves = nuts._Chains(None, jnp.ones(2), jnp.zeros((2, 3, 3)))
    monkeypatch.setattr(nuts, "_warm_up", lambda *_: moves)
    monkeypatch.setattr(nuts, "_advance", advance)
    drawn = sample_nuts(problem, found, seed=5, chains=2, draws=25, chunk=10)
    assert begun == [0, 10, 20] and drawn.log_density.shape == (2, 30)


def test_trajectories_that_broke_down_or_were_cut_are_counted(problem):
    """Of two chains of five draws: one diverged, two came to the largest number of doublings."""
    depth = np.array([[1, 2, 10, 3, 4], [2, 2, 2, 10, 1]])
    kept = {"unconstrained": np.zeros((2, 5, 3)), "log_density": np.zeros((2, 5)), "diverging": depth == 4}
    kept |= {"acceptance_rate": np.full((2, 5), 0.9), "n_steps": 2**depth, "tree_depth": depth}
    kept["energy"] = np.zeros((2, 5))
    moves = nuts._Chains(None, jnp.asarray([0.5, 0.7]), jnp.zeros((2, 3, 3)))
    settings = {"seed": 3, "most_doublings": 10}
    drawn = nuts._result(moves, {name: [values] for name, values in kept.items()}, settings, 4, 1.0)
    assert drawn.message.startswith("5 draws of each chain, of which 4 were asked for; ")
    assert not drawn.finished and drawn.divergences == 1 and drawn.seed == 3
    assert "; 1 trajectories diverged" in drawn.message
    assert "; 2 trajectories were cut short at 10 doublings" in drawn.message
    assert drawn.evaluations == np.sum(2**depth) and drawn.settings["step_size"] == pytest.approx(0.6)
    whole = {name: [np.minimum(values, 9) if name == "tree_depth" else values] for name, values in kept.items()}
    whole["diverging"] = [np.zeros((2, 5), dtype=bool)]
    sound = nuts._result(moves, whole, settings, 5, 1.0)
    assert sound.finished and sound.message == "5 draws of each chain, as asked"


def test_draws_of_the_normal_approximation_say_that_they_are_none_of_the_posterior(problem, found):
    effort = study.Effort(draws=500, chains=3)
    drawn = study._normal_draws(problem, found, 4, effort)
    assert drawn.unconstrained.shape == (3, 500, 3) and not drawn.finished and drawn.seed == 4
    mean, covariance, _ = exact_posterior(problem)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((drawn.flat.mean(axis=0) - mean) / sd, 0.0, atol=4.0 / np.sqrt(1500.0))
    np.testing.assert_allclose(drawn.flat.std(axis=0) / sd, 1.0, atol=4.0 / np.sqrt(3000.0))
    np.testing.assert_allclose(drawn.log_density.ravel(), batched_log_density(problem)(drawn.flat), rtol=1e-12)
    assert any("a normal approximation about the mode" in said for said in diagnose_draws(problem, drawn).complaints)
    with pytest.raises(InputError, match="the evidence needs draws of the posterior"):
        study._weighed(problem, drawn, study.Sampler.LAPLACE, 4, effort)


def test_a_study_passes_on_every_warning(problem, found):
    """Of the audit, of profiles, of the normal approximation, of the evidence, and of the draws, in this order."""
    effort = study.Effort(starts=1, with_profiles=False)
    looked_at = study.infer(problem, sampler=study.Sampler.NONE, effort=effort)
    (alone,) = looked_at.warnings
    assert "has a single start" in alone and looked_at.estimates[0] is looked_at.fit.values
    np.testing.assert_allclose(looked_at.fit.values, exact_posterior(problem)[0], rtol=1e-6)
    np.testing.assert_allclose(looked_at.estimates[1], np.sqrt(np.diag(exact_posterior(problem)[1])), rtol=1e-6)
    sides = {"rise": np.zeros(2), "threshold": 1.92, "interval": (0.0, 1.0), "refits": (5, 5), "unfinished": (0, 0)}
    sides |= {"unit": "m", "level": 0.95, "values": np.arange(2.0)}
    sound = Profile(name="coefficient_0", stops=(Stop.CROSSED, Stop.CROSSED), **sides)
    lower = Profile(name="coefficient_1", stops=(Stop.LOWER_MINIMUM, Stop.CROSSED), **sides)
    doubtful = dataclasses.replace(
        looked_at,
        profiles=(sound, lower),
        laplace=dataclasses.replace(found, converged=False, message="not a mode"),
        evidence=Evidence(-3.0, 0.5, 0.9, True, ("the error is large.",)),
        diagnostics=Diagnostics((), ("chains do not agree.",)),
    )
    said = doubtful.warnings
    assert said[0] == alone and said[1].startswith("Profile of coefficient_1: the lower side found a lower cost")
    assert said[2:] == (
        "Normal approximation: not a mode.", "Evidence: the error is large.", "chains do not agree.",
    )  # fmt: skip
    assert dataclasses.replace(looked_at, laplace=found).warnings == (alone,)


def test_files_of_other_runs_are_refused(problem, found, tmp_path):
    start, file = walkers_from_laplace(problem, found, count=16), tmp_path / "run.h5"
    sample_ensemble(problem, start, seed=5, most_steps=10, check_every=10, file=file)
    for other, said in (
        (problem.draw_data(jax.random.key(0), problem.start), "its measured data differ"),
        (conjugate_problem(2), "its parameters differ"),
        (conjugate_problem(sd=0.5), "data differ"),
        (
            Problem(problem.parameters.without(["coefficient_2"]), problem.model, problem.measurements),
            "parameters differ",
        ),
        (Problem(problem.parameters, problem.model, (_louder(problem),)), "its log density at the start was"),
    ):
        with pytest.raises(InputError, match=said):
            sample_ensemble(other, start[:, : other.parameters.size], seed=5, file=file)
    with pytest.raises(InputError, match="was begun with `seed` 5, asked for is 6"):
        sample_ensemble(problem, start, seed=6, file=file)
    with pytest.raises(InputError, match="was begun with `sampler` emcee, asked for is nuts"):
        sample_nuts(problem, found, seed=5, file=file)
    (tmp_path / "no.h5").write_text("not HDF5")
    for sample in (lambda: sample_ensemble(problem, start, seed=5, file=tmp_path / "no.h5"),
                   lambda: sample_nuts(problem, found, seed=5, file=tmp_path / "no.h5")):  # fmt: skip
        with pytest.raises(InputError, match="is no HDF5 file"):
            sample()


def test_a_file_is_told_from_another_problem_s_where_the_start_has_no_density(tmp_path):
    """A model's own value may lie outside of a prior; what else differs shows at a draw of it."""
    problem = conjugate_problem()
    entries = (parameter("coefficient_0", "model.coefficients[0]", "m", Uniform(50.0, 51.0)),)
    outside = problem.with_parameters(type(problem.parameters)(entries))
    told = fingerprint(outside)
    assert np.isfinite(told["log_density_at_start"])
    other = Problem(outside.parameters, outside.model, (_louder(outside),))
    with pytest.raises(InputError, match="its log density at the start was"):
        refuse_other_problem(told, other, "run.h5")


def test_a_study_refuses_a_file_of_another_run_before_it_fits(problem, found, tmp_path, monkeypatch):
    file = tmp_path / "run.h5"
    sample_ensemble(problem, walkers_from_laplace(problem, found, count=16), seed=5, most_steps=10, file=file)
    monkeypatch.setattr(study, "fit", None)
    for sampler, seed, said in ((study.Sampler.EMCEE, 6, "`seed` 5"), (study.Sampler.NUTS, 5, "`sampler` emcee")):
        with pytest.raises(InputError, match=f"was begun with {said}"):
            study.infer(problem, sampler=sampler, seed=seed, file=file)


def test_a_study_does_as_its_effort_says(problem, monkeypatch):
    """The acceptance that NUTS aims at, which belongs to a run; and no more starts are advised than can be had."""
    asked = {}

    def stopped(*_, **settings):
        asked.update(settings)
        raise InterruptedError

    effort = study.Effort(starts=2, target_acceptance=0.95, with_profiles=False)
    monkeypatch.setattr(study, "sample_nuts", stopped)
    with pytest.raises(InterruptedError):
        study.infer(problem, seed=5, effort=effort)
    assert asked["target_acceptance"] == 0.95
    monkeypatch.setattr(study, "audit", stopped)
    for most, more in ((None, True), (2, False), (4, True)):
        with pytest.raises(InterruptedError):
            study.infer(problem, effort=dataclasses.replace(effort, most_starts=most))
        assert asked["may_have_more_starts"] is more


def test_another_acceptance_is_another_run(problem, found, tmp_path, monkeypatch):
    file = tmp_path / "run.h5"
    sample_nuts(problem, found, seed=5, warmup=20, draws=10, chunk=10, file=file)
    monkeypatch.setattr(study, "fit", None)
    with pytest.raises(InputError, match="was begun with `target_acceptance` 0.8"):
        study.infer(problem, seed=5, effort=study.Effort(target_acceptance=0.9), file=file)


def _louder(problem):
    measurement = problem.measurements[0]
    noise = type(measurement.noise)(known=2.0 * measurement.noise.known)
    return type(measurement)("line", measurement.predict, measurement.measured, measurement.series, noise, "m")


def test_what_cannot_be_sampled_is_refused(problem, found):
    start = walkers_from_laplace(problem, found, count=16)
    with pytest.raises(
        InputError, match="7 walkers do not suffice for 3 parameters: take an even number of at least 6"
    ):
        sample_ensemble(problem, start[:7], seed=0)
    with pytest.raises(InputError, match="3 unconstrained numbers each, got 2"):
        sample_ensemble(problem, start[:, :2], seed=0)
    with pytest.raises(InputError, match="snooker move has a wrong acceptance"):
        sample_ensemble(problem, start, seed=0, moves=[(emcee.moves.DESnookerMove(), 1.0)])
    astray = start.copy()
    astray[3] = np.inf
    with pytest.raises(InputError, match="starts where the log density is not finite"):
        sample_ensemble(problem, astray, seed=0)
    bare = type(problem.parameters)((parameter("slope", "model.coefficients[0]", "m"),))
    with pytest.raises(InputError, match="`slope` has no prior, so that there is no posterior"):
        laplace(problem.with_parameters(bare))
    with pytest.raises(InputError, match="nothing is free"):
        laplace(problem.with_parameters(type(problem.parameters)(())))


def test_a_density_that_is_nowhere_a_number_is_refused(problem, found):
    measurement = problem.measurements[0]
    broken = type(measurement)(
        "line", measurement.predict, measurement.measured * jnp.nan, measurement.series, measurement.noise, "m"
    )
    nowhere = Problem(problem.parameters, problem.model, (broken,))
    with pytest.raises(InputError, match="not finite at the start nor at any draw of the prior"):
        laplace(nowhere)
    with pytest.raises(InputError, match="only 0 of 800 points to start from have a finite log density"):
        walkers_from_prior(nowhere, count=16)


@pytest.fixture(scope="module")
def holed(problem, found):
    """The same posterior with a ring about its mode in which the model predicts nothing."""
    (measurement,) = problem.measurements
    mode, sd = np.asarray(found.mode), float(found.sd[0])

    def predict(model):
        away = jnp.abs(model.coefficients[0] - mode[0]) / sd
        return jnp.where((away > 0.8) & (away < 1.2), jnp.nan, measurement.predict(model))

    return dataclasses.replace(problem, measurements=(dataclasses.replace(measurement, predict=predict),)), mode, sd


def in_hole(draws, mode, sd):
    away = np.abs(draws.flat[:, 0] - mode[0]) / sd
    return np.mean((away > 0.8) & (away < 1.2)), np.mean(away >= 1.2)


def test_holes_in_the_density_are_walked_around(holed, found):
    """The ensemble jumps over the ring, never into it, and finds what the posterior has beyond it."""
    problem, mode, sd = holed
    start = walkers_from_laplace(problem, found, count=32)
    draws = sample_ensemble(problem, start, seed=0, most_steps=1500, check_every=500)
    assert np.all(np.isfinite(draws.log_density))
    inside, beyond = in_hole(draws, mode, sd)
    # Of a normal density 23 percent lie beyond 1.2 standard deviations and 19 in the ring, of which nothing is left.
    left = stats.norm.cdf([0.8, 1.2])
    expected = (1.0 - left[1]) / (1.0 - left[1] + left[0] - 0.5)
    assert inside == 0.0 and beyond == pytest.approx(expected, abs=0.05)


@pytest.mark.slow
def test_chains_stay_out_of_holes(holed, found):
    """A trajectory that enters the ring is refused."""
    problem, mode, sd = holed
    draws = sample_nuts(problem, found, seed=1, chains=2, warmup=300, draws=300)
    assert np.all(np.isfinite(draws.log_density)) and in_hole(draws, mode, sd)[0] == 0.0


def test_a_prior_that_ends_is_not_left(problem):
    """No density beyond, and none is found there."""
    entries = (parameter("coefficient_0", "model.coefficients[0]", "m", Uniform(-1.0, 1.0)),)
    bounded = problem.with_parameters(type(problem.parameters)(entries))
    approximated = laplace(bounded)
    draws = sample_ensemble(
        bounded, walkers_from_laplace(bounded, approximated, count=8), seed=0, most_steps=100, check_every=50
    )
    assert np.all(np.isfinite(draws.log_density))
    assert np.all(np.abs(batched_values(bounded, draws.flat)) <= 1.0)
    assert coordinate_names(bounded.parameters) == ("coefficient_0",)


def test_batches_in_chunks_are_the_same(problem, found):
    points = found.draw(jax.random.key(1), 13)
    whole = batched_log_density(problem)(points)
    np.testing.assert_allclose(batched_log_density(problem, chunk=4)(points), whole, rtol=1e-12)
    np.testing.assert_allclose(whole, [problem.log_density(jnp.asarray(u)) for u in points], rtol=1e-12)
    assert fingerprint(problem)["parameters"] == "coefficient_0 [m], coefficient_1 [m], coefficient_2 [m]"


def test_fewer_walkers_where_each_of_them_takes_long(problem):
    (measurement,) = problem.measurements
    long = dataclasses.replace(problem, measurements=(dataclasses.replace(measurement, is_long=True),))
    assert default_walkers(problem) == 128 and default_walkers(long) == 16


def test_stop_rule_in_numbers():
    rule, settled = StopRule(), np.array([10.0, 20.0])
    assert rule.long_enough(settled, settled, 1001) and not rule.long_enough(settled, settled, 1000)
    assert not rule.long_enough(1.02 * settled, settled, 5000) and rule.long_enough(1.009 * settled, settled, 5000)
    assert not rule.long_enough(np.full(2, np.inf), settled, 5000)


KILLED = """
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
from inverse.sampling import laplace, sample_ensemble, sample_nuts, walkers_from_laplace
from tests.inverse.sampling.conjugate import conjugate_problem
problem = conjugate_problem()
found = laplace(problem)
file = Path(sys.argv[2])
if sys.argv[1] == "nuts":
    sample_nuts(problem, found, seed=5, chains=2, warmup=100, draws=10**8, chunk=10, file=file)
start = walkers_from_laplace(problem, found, count=16)
sample_ensemble(problem, start, seed=5, most_steps=10**8, check_every=10, file=file)
"""


def _has_draws(file):
    if not file.exists():
        return False
    with h5py.File(file, "r") as opened:  # readable whenever it is there
        return len(opened["log_density"] if "log_density" in opened else opened["mcmc/log_prob"]) > 0


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["nuts", "ensemble"])
def test_a_killed_run_leaves_a_file_that_goes_on(sampler, problem, found, tmp_path):
    file = tmp_path / "run.h5"
    child = subprocess.Popen([sys.executable, "-c", KILLED, sampler, str(file)], env={**os.environ, "PYTHONPATH": "."})
    try:
        deadline = time.monotonic() + 200.0
        while not _has_draws(file) and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.5)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    if sampler == "nuts":
        resumed = sample_nuts(problem, found, seed=5, chains=2, warmup=100, draws=20, chunk=10, file=file)
        whole = sample_nuts(problem, found, seed=5, chains=2, warmup=100, draws=20, chunk=10)
        np.testing.assert_array_equal(resumed.unconstrained[:, :20], whole.unconstrained)
    else:
        start = walkers_from_laplace(problem, found, count=16)
        done = int(HDFBackend(str(file), read_only=True).iteration)
        assert done >= 10
        again = sample_ensemble(problem, start, seed=5, most_steps=done + 20, check_every=10, file=file)
        assert again.settings["steps"] >= done
