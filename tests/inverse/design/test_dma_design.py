"""A design of a DMA on two small sweeps: in which noise, with what put in, where looked, and for which sample."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from arfjax import InputError
from inverse.design import design_dma, dma_design
from inverse.design.dma_proposals import DmaProposal, dma_proposals
from inverse.diagnosis import DMA_CAUSES, Diagnosis
from inverse.diagnosis.diagnosis import CauseReport
from inverse.diagnosis.dma import examination
from inverse.diagnosis.dma.problem import dma_problem
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.inverse.design.small import as_modelled

STRENGTHS = {"bath-viscosity": 2.0, "slip": 0.2, "phase-delay": -1e-4}


def of_cause(name):
    """As estimated, which is more than would be seen."""
    cause = next(one for one in DMA_CAUSES if one.name == name)
    strength = STRENGTHS[name]
    return CauseReport(
        cause, None, 5.0, 1e-4, 1e-4, strength, (strength, strength), 0.5 * abs(strength), "possible", None, True, None
    )


def diagnosed(problem, size, decision=None):
    found = object.__new__(Diagnosis)
    said = {field.name: None for field in dataclasses.fields(Diagnosis)} | {
        "verdict": "confusable", "noise": SimpleNamespace(size=size), "problem": problem, "decision": decision,
        "causes": tuple(of_cause(name) for name in STRENGTHS), "not_testable": (),
    }  # fmt: skip
    for name, value in said.items():
        object.__setattr__(found, name, value)
    return found


@pytest.fixture(scope="module")
def data():
    return as_modelled(20.0, 40.0)


@pytest.fixture(scope="module")
def problem(data):
    return dma_problem(data, FRACTIONAL)


@pytest.fixture(autouse=True)
def one_proposal(monkeypatch):
    """The same sweeps once more, which are soon rated."""
    monkeypatch.setattr(dma_design, "dma_proposals", lambda *data, **asked: dma_proposals(*data, **asked)[:1])


def test_noise_is_that_of_the_usual_reading_where_a_file_states_its_own(data, problem):
    """A percent in the magnitude and two in the phase, less of one reading, and one and a half times what is stated."""
    stated = np.tile([0.01, 0.02], (14, 1))
    stated[3] = 1e-4
    found = diagnosed(dataclasses.replace(problem, weights=1.0 / stated), 1.5)
    told = design_dma(data, found=found, check=False, locate=False)
    assert told.sizes == pytest.approx((0.015, 0.03)) and told.causes == STRENGTHS and told.notes == ()
    finer = design_dma(data, found=diagnosed(found.problem, 0.5), check=False, locate=False)
    np.testing.assert_allclose(finer.now.d_prime, 3.0 * told.now.d_prime, rtol=1e-9)
    assert np.all(told.rated[0].separation.d_prime > told.now.d_prime)


def test_the_best_proposal_is_simulated_with_each_cause_as_strong_as_it_is(data, problem, monkeypatch):
    """All readings, the old ones too, as the fitted solid and one cause have them, in noise of their own."""
    simulated, asked = [], []

    def again(data, **more):
        simulated.append(data)
        asked.append(more)
        return diagnosed(problem, 1e-6, decision=SimpleNamespace(named=("slip",), confusable=()))

    found = diagnosed(problem, 1e-6)
    monkeypatch.setattr(dma_design, "diagnose_dma", again)
    names = ("bath-viscosity", "phase-delay")
    library = DMA_CAUSES[:-1]
    told = design_dma(data, found=found, causes=names, library=library, locate=False, seed=3)
    assert [(one.hidden, one.named) for one in told.checks] == [(name, ("slip",)) for name in names]
    assert all(one["causes"] is library for one in asked)
    assert all(not one["gain"] and one["seed"] == 3 and one["model"] is FRACTIONAL for one in asked)
    clean = as_modelled(20.0, 40.0)
    assert clean.storage_modulus is not None and clean.loss_modulus is not None
    modulus = clean.storage_modulus + 1j * clean.loss_modulus
    whole = dict(zip(zip(clean.frequency_hz, clean.temperature_c, strict=True), modulus, strict=True))
    left = []
    for name, one in zip(names, simulated, strict=True):
        assert len(one) == 28 and np.ptp(one.time_s) > 1.9 * np.ptp(data.time_s)
        solid = np.array([whole[key] for key in zip(one.frequency_hz, one.temperature_c, strict=True)])
        omega = 2.0 * np.pi * one.frequency_hz
        read = one.storage_modulus + 1j * one.loss_modulus
        expected = solid + 2.0j * omega if name == "bath-viscosity" else solid * np.exp(-1e-4j * omega)
        np.testing.assert_allclose(read, expected, rtol=1e-4)
        np.testing.assert_allclose(one.modulus_magnitude, np.abs(read))
        left.append(np.log(read / expected))
    # A drift of the fit is common to both; their noise is not.
    assert np.std(left[0] - left[1]) == pytest.approx(2.0 * 1e-6, rel=0.5)


def test_one_more_reading_is_sought_for_the_two_that_are_the_hardest_to_tell_apart(data, problem, monkeypatch):
    seen = []
    monkeypatch.setattr(dma_design, "dma_information", lambda *given: seen.append(given))
    told = design_dma(data, found=diagnosed(problem, 0.3), check=False)
    ((whole, extensions, strengths, size),) = seen
    names = [one.cause.name for one in extensions]
    # In much noise, slip is the weakest.
    assert told.now.closest[0] == 1
    assert names == [told.now.names[place] for place in told.now.closest]
    assert strengths.tolist() == [STRENGTHS[name] for name in names] and size.tolist() == [0.3, 0.3]
    assert whole is problem and told.information is None


def test_the_sample_that_is_measured_again_is_the_first_that_can_be_fitted(data, problem):
    """Without times, and of magnitudes alone: the first has three frequencies only."""
    few = np.concatenate([[0, 3, 6], np.arange(14)])
    both = dataclasses.replace(
        data.select(few), time_s=None, storage_modulus=None, loss_modulus=None, sample=("a",) * 3 + ("b",) * 14
    )
    found = diagnosed(dataclasses.replace(problem, weights=np.ones((14, 1))), 0.01)
    told = design_dma(
        both, found=found, model=CONVENTIONAL, causes=("slip", "bath-viscosity"), check=False, locate=False
    )
    (one,) = told.rated
    assert isinstance(one.proposal, DmaProposal) and one.proposal.sample == "b"
    assert one.proposal.seconds is None and one.proposal.time[0] == 14.0
    assert told.sizes == (0.01,) and told.now.names == ("slip", "bath-viscosity")
    # The same once more: what does not look at the time is seen better by the root of two. (A bath is not seen by
    # magnitudes of a solid of one relaxation time, whose constants imitate it.)
    np.testing.assert_allclose(one.separation.d_prime[0], np.sqrt(2.0) * told.now.d_prime[0], rtol=1e-3)


def test_a_cause_that_the_data_cannot_see_is_refused_before_anything_is_refitted(data, monkeypatch):
    """That takes seconds; the decision with its refits takes minutes of a large measurement."""

    def decided(*_, **__):
        raise AssertionError("went on to the decision")

    monkeypatch.setattr(examination, "decide", decided)
    with pytest.raises(InputError, match=r"cannot see 'clamp-compliance': the fitted constants imitate .*; they see"):
        design_dma(data, causes=("slip", "clamp-compliance"))
    with pytest.raises(AssertionError, match="went on"):
        design_dma(data, causes=("slip", "phase-delay"))


def test_where_it_was_measured_a_solid_has_the_constants_that_were_fitted():
    """However fast it relaxes: here in a millisecond."""
    fast = dma_problem(as_modelled(60.0), FRACTIONAL)
    assert fast.constants[0, 2] < 2e-3
    for temperature in (50.0, 60.0, 70.0):
        np.testing.assert_allclose(dma_design._constants_at(fast, "", temperature), fast.constants[0], rtol=1e-12)
