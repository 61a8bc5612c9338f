"""A cause that explains by far the most is named although something is left; nothing else is."""

import numpy as np
import pytest

from inverse.datasets.dma import dma_data
from inverse.diagnosis import diagnose_dma
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
