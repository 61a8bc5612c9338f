"""A cause that explains by far the most is named although something is left; nothing else is."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from inverse.datasets.dma import dma_data
from inverse.diagnosis import DMA_CAUSES, diagnose_dma
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.decision import decide
from inverse.diagnosis.diagnosis import _report, _with_dominant
from inverse.diagnosis.examination import Examined
from inverse.diagnosis.noise import noise_family, series
from inverse.diagnosis.screening import Alternative
from tests.blind import dma_generator as blind


def diagnosed(seed, large, strength, nameless, d_prime):
    """A named effect of one d' (none without a name) and one of no name of another, in one measurement."""
    rng = np.random.default_rng([seed, 77])
    m = blind.draw_measurement(rng)
    logarithm = blind.hidden(m, large, strength, rng)[0] if large else np.log(blind.solid(m.constants, m.omega))
    direction = blind.UNKNOWN[nameless](m, rng)
    scale = d_prime * blind.NOISE / blind.length_after_fit(m, np.log(blind.solid(m.constants, m.omega)) + direction)
    modulus = np.exp(logarithm + scale * direction + blind.NOISE * blind.draw_noise("white", m, rng))
    values = np.stack([modulus.real.ravel(), np.maximum(modulus.imag.ravel(), 1e-3)], axis=-1)
    data = dma_data(np.tile(m.frequency, 5), np.repeat(m.temperature, 14), values)
    return diagnose_dma(data, seed=seed, gain=False)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["instrument-inertia", "frame-resonance", "slip"])
def test_a_cause_that_dwarfs_what_is_left_is_named_beside_it(name):
    """d' of 50 against 8: 97 % of the squares."""
    found = diagnosed(520, name, 50.0, "mains", 8.0)
    assert found.verdict in ("unexplained", "named") and name in found.named


@pytest.mark.slow
@pytest.mark.parametrize("nameless", ["smooth", "one-temperature", "bump"])
def test_a_large_effect_of_no_name_names_none(nameless):
    found = diagnosed(521, "", 0.0, nameless, 40.0)
    assert found.verdict == "unexplained" and found.named == ()


@pytest.mark.slow
def test_an_effect_of_no_name_as_large_as_the_cause_keeps_it_from_being_named():
    """Half of the squares each: the cause explains much, not by far the most."""
    found = diagnosed(522, "instrument-inertia", 25.0, "bump", 25.0)
    assert found.verdict == "unexplained" and found.named == ()


COUNT = 60
AT = np.linspace(0.0, 1.0, COUNT)


def examined(refits):
    """Of three causes none of which was enough; each leaves a part of the squares, if it converged."""
    causes = DMA_CAUSES[:3]
    data = np.sin(9.0 * AT) * 3.0 + np.random.default_rng(1).standard_normal(COUNT)
    effects = [Alternative(one.name, np.sin((9.0 + 3.0 * k) * AT)[:, None]) for k, one in enumerate(causes)]
    family, fitted = noise_family((series("frequency", [0] * COUNT, AT),), AT)[:1], np.ones((COUNT, 1))
    decision = decide(data, fitted, effects, [], family, np.random.default_rng(1))
    tests = {one.name: dataclasses.replace(decision.omnibus) for one in causes}
    decision = dataclasses.replace(
        decision, verdict="unexplained", explanations=(), last=decision.omnibus, tests=tests,
        candidates={one.name: 0.001 for one in causes},
    )  # fmt: skip
    shares = {one.name: refit for one, refit in zip(causes, refits, strict=True)}

    def fit(extensions, noise, start, profile):
        share, converged = shares[extensions[0].cause.name]
        return SimpleNamespace(residuals=np.sqrt(share) * data, converged=converged)

    return Examined(causes, data, fitted, tuple(effects), (), (), family, decision, fit, ())


@pytest.mark.parametrize(
    ("refits", "named"),
    [
        # A quarter of the squares, and half of what the next best leaves, are the most that may be left.
        ([(0.24, True), (0.50, True), (0.9, True)], 0),
        ([(0.9, True), (0.50, True), (0.24, True)], 2),
        ([(0.26, True), (0.90, True), (0.9, True)], None),
        ([(0.24, True), (0.46, True), (0.9, True)], None),
        # A refit that did not converge is none: neither the best nor the next best.
        ([(0.24, True), (0.30, False), (0.9, True)], 0),
        ([(0.10, False), (0.30, True), (0.9, True)], None),
    ],
)
def test_how_much_has_to_be_explained_and_by_how_much_more_than_by_the_next(refits, named):
    before = examined(refits)
    found = _with_dominant(before)
    assert found.verdict == "unexplained"
    if named is None:
        assert found is before.decision and found.named == ()
    else:
        name = before.causes[named].name
        assert found.named == (name,) and found.last is before.decision.tests[name]
    other = dataclasses.replace(before, decision=dataclasses.replace(before.decision, verdict="adequate"))
    assert _with_dominant(other) is other.decision


def test_of_two_that_are_named_together_each_has_its_own_strength_and_interval():
    """Of the refit with both; of one that was not put in the linearised model has it, within what there can be."""
    before = examined([(0.5, True)] * 3)
    first, second, third = before.causes
    decision = dataclasses.replace(before.decision, explanations=((first.name, second.name),), candidates={})
    both = SimpleNamespace(
        extensions=(Extension(second, 0.0), Extension(first, 0.0)), strengths=np.array([2.0, 1.0]),
        intervals=np.array([[1.5, 2.5], [0.75, 1.25]]), converged=True, residuals=before.residuals,
        directions=before.fitted,
    )  # fmt: skip
    told = {one.name: _report(before, decision, both, one.name, 0.125, False) for one in before.causes}
    assert (told[first.name].estimate, told[first.name].interval) == (1.0, (0.75, 1.25))
    assert (told[second.name].estimate, told[second.name].interval) == (2.0, (1.5, 2.5))
    assert told[first.name].refit is both is told[second.name].refit and told[third.name].refit is None
    assert [told[one.name].status for one in before.causes] == ["named", "named", "not needed"]
    # Ordinary least squares beside a level, with Student's t of 58 degrees of freedom.
    column = np.sin(15.0 * AT) - np.mean(np.sin(15.0 * AT))
    found = column @ before.residuals / (column @ column)
    rest = before.residuals - np.mean(before.residuals) - found * column
    reach = 2.0017 * np.sqrt(rest @ rest / 58.0) / np.linalg.norm(column)
    assert told[third.name].estimate == pytest.approx(found, rel=1e-9) and third.sign == 0
    assert told[third.name].interval == pytest.approx((found - reach, found + reach), rel=1e-4)
    assert told[third.name].detectability == 0.125
