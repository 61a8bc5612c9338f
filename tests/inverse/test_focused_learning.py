"""What the fast model of an inference learns from, and what is said of it: no simulation is made here."""

from pathlib import Path
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from arfjax import FastCurve, discretise, read_experiment
from inverse import hmi_problem as module
from inverse.datasets.hmi import HmiData
from inverse.datasets.shipped import shipped
from inverse.fast_hmi import FastHmi, Verification
from inverse.hmi_problem import FastPrediction, hmi_problem
from inverse.inference.experiment import anchored, inference_settings
from inverse.inference.sonications import Sonications

DESCRIBED = read_experiment(shipped("suomi2016_experiment"))
SETTINGS = inference_settings(DESCRIBED, "suomi2016_experiment")
STANDING = float(anchored(DESCRIBED.model(), SETTINGS).lesion.viscoelasticity.branch_modulus.value)
SETTINGS_OF_SOUND = discretise(DESCRIBED.model(), refinement=0.4)
CURVE = HmiData(Path("none"), ("1",) * 4, np.array([37.0, 50.0, 60.0, 70.0]), None, np.full(4, 99.0), True, None, ())


@pytest.fixture
def learnt(monkeypatch):
    """Draws that the fast model learnt from, every time it did."""
    found = []

    def prepared(draws, sweeps, *_, **__):
        found.append(draws)
        return FastHmi(object.__new__(FastCurve), sweeps)

    monkeypatch.setattr(module, "prepare_fast", prepared)
    return found


def approximated(monkeypatch, **said):
    """A normal approximation, every draw of which is a tenth above the mode in every number."""

    def normal(problem, **_):
        mode = np.asarray(problem.start)
        drawn = {"draw": lambda _, count: mode + 0.1 * np.ones((count, len(mode)))}
        return SimpleNamespace(mode=mode, **({"converged": True, "positive_definite": True} | drawn | said))

    monkeypatch.setattr(module, "laplace", normal)


def stiffness(models):
    return np.array([float(model.lesion.viscoelasticity.branch_modulus.value) for model in models])


def made():
    return hmi_problem(DESCRIBED, SETTINGS, CURVE, discretisation=SETTINGS_OF_SOUND)


def test_it_learns_from_the_priors_a_third_wider_and_then_around_the_mode(learnt, monkeypatch):
    """Draws of the approximation, one and three quarters as far from its mode, and the mode itself."""
    approximated(monkeypatch)
    found = made()
    assert found.remark == ""
    broad, focused = (np.log(stiffness(draws) / STANDING) for draws in learnt)
    # A prior with half a unit of the logarithm, of whose spread a hundred draws tell a fourteenth.
    assert len(broad) == 100 and np.std(broad) == pytest.approx(0.5 * 4.0 / 3.0, rel=0.2)
    assert len(focused) == 61 and focused[0] == pytest.approx(0.0, abs=1e-9)
    there = found.problem.values(jnp.asarray(found.problem.start) + 1.75 * 0.1)
    place = found.problem.parameters.names.index("lesion_stiffness")
    np.testing.assert_allclose(focused[1:], np.log(there[place] / STANDING), rtol=1e-9)


@pytest.mark.parametrize("broken", ["converged", "positive_definite"])
def test_without_a_normal_approximation_it_learns_once_and_that_is_said(learnt, monkeypatch, broken):
    approximated(monkeypatch, **{broken: False, "message": "mode reached by 1 of 3 starts"})
    assert "from the priors alone, because no normal approximation" in made().remark
    assert len(learnt) == 1


class Part(FastHmi):
    """Rows of one sonication; how far the lesion's stiffness is above the usual one is the error there."""

    curve: None = None  # type: ignore[assignment]
    sweeps: tuple = ()
    row: int = eqx.field(static=True, default=0)

    def verify(self, models, settings, *, n_rows, in_percent, on_step):
        on_step("models", len(models), len(models))
        full = np.zeros((len(models), n_rows))
        full[:, self.row] = 100.0
        fast = full * (stiffness(models) / STANDING)[:, None]
        return Verification(fast, full, stiffness(models) < 2.0 * STANDING)


def test_parts_are_verified_with_their_own_models_and_all_have_to_cover():
    place, told = ("lesion.viscoelasticity.branch_modulus.value",), []
    prediction = FastPrediction((Part(row=0), Part(row=2)), 3, True)
    factors = ((1.1, 0.7), (1.0, 3.0))
    models = [Sonications(DESCRIBED.model(), (tuple(one * STANDING for one in each),), place, 2) for each in factors]
    checked = prediction.verify(models, SETTINGS_OF_SOUND, on_step=told.append)
    np.testing.assert_allclose(checked.fast, [[110.0, 0.0, 70.0], [100.0, 0.0, 300.0]])
    np.testing.assert_array_equal(checked.full, [[100.0, 0.0, 100.0]] * 2)
    np.testing.assert_array_equal(checked.covered, [True, False])
    assert checked.largest_error == pytest.approx(0.3) and told == ["full model: models 2 of 2"] * 2
