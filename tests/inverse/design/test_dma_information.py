"""Where one more reading tells most: against least squares under bounds, on one small sweep."""

import dataclasses

import numpy as np
import pytest

from inverse.design import dma_information
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.problem import dma_problem
from inverse.dma_fit import FRACTIONAL
from tests.inverse.design.small import as_modelled, left_by_reading

NAMES = ("noise-floor", "strain-nonlinearity")
SIZE = np.array([0.02, 0.05])


@pytest.fixture(scope="module")
def problem():
    """Of which a magnitude weighs twice as much as a phase."""
    found = dma_problem(as_modelled(40.0), FRACTIONAL)
    return dataclasses.replace(found, weights=found.weights * np.array([2.0, 1.0]))


@pytest.fixture(scope="module")
def extensions():
    known = {cause.name: cause for cause in DMA_CAUSES}
    return [Extension(known[name], 0.0) for name in NAMES]


@pytest.mark.parametrize("softening", [0.3, -0.3])
def test_a_reading_tells_what_constants_and_a_rival_of_its_sign_cannot_imitate(problem, extensions, softening):
    """A floor of the noise stiffens what is soft: it is no answer to softening, and one to stiffening."""
    strengths = np.array([4e5, softening])
    told = dma_information.dma_information(problem, extensions, strengths, SIZE)
    left = left_by_reading(problem, extensions, strengths)
    expected = np.min([0.5 * np.sum((one / SIZE) ** 2, axis=1) for one in left], axis=0)
    # Neither cause looks at the time: where something was measured already, it tells as much as that did.
    omega = np.asarray(problem.conditions.angular_frequency)
    ends = [int(np.argmin(omega)), int(np.argmax(omega))]
    np.testing.assert_allclose(told.nat[0, [0, -1]], expected[ends], rtol=1e-4)
    assert told.causes == NAMES and told.nat.shape == (1, 29) and told.temperature.tolist() == [40.0]
    np.testing.assert_allclose(told.frequency[[0, -1]], omega[ends] / (2.0 * np.pi))
    np.testing.assert_allclose(np.diff(np.log(told.frequency)), np.log(told.frequency[1] / told.frequency[0]))
    assert told.best >= np.max(told.nat) * (1.0 - 1e-9) and told.best_temperature == 40.0
    nearest = int(np.argmin(np.abs(np.log(told.frequency / told.best_frequency))))
    assert abs(nearest - int(np.argmax(told.nat[0]))) <= 1
    assert told.best == pytest.approx(np.max(told.nat), rel=0.05)


def test_a_rival_of_one_sign_imitates_nothing_that_goes_the_opposite_way():
    rng = np.random.default_rng(2)
    fitted, rival = rng.standard_normal((12, 2)), rng.standard_normal(12)
    target = fitted @ [1.0, -2.0] - 3.0 * rival
    np.testing.assert_allclose(dma_information._imitation(fitted, rival, 0, target), [1.0, -2.0, -3.0])
    np.testing.assert_allclose(dma_information._imitation(fitted, -rival, 1, target), [1.0, -2.0, 3.0])
    kept = dma_information._imitation(fitted, rival, 1, target)
    np.testing.assert_allclose(kept, [*np.linalg.lstsq(fitted, target, rcond=None)[0], 0.0])
