"""What a cause does to readings that there are does not change with those that are still to come."""

import numpy as np
import pytest

from inverse.design import dma_design
from inverse.design.dma_proposals import dma_proposals
from inverse.diagnosis import DMA_CAUSES
from inverse.diagnosis.cause import Extension
from inverse.diagnosis.dma.problem import dma_problem
from inverse.dma_fit import FRACTIONAL
from tests.inverse.design.small import as_modelled


def with_each(*temperatures):
    """The problem of so many sweeps, and with each proposal beside it."""
    data = as_modelled(*temperatures)
    problem, found = dma_problem(data, FRACTIONAL), {}
    for proposal in dma_proposals(data):
        found[proposal.name] = dma_design._further(dma_design._with(data, problem, proposal), problem, 0)
    return problem, found


@pytest.fixture(scope="module")
def together():
    return with_each(20.0, 40.0)


@pytest.fixture(scope="module")
def at_one_temperature():
    """Where every proposal goes on at the temperature that was measured last."""
    return with_each(20.0)


@pytest.mark.parametrize("name", ["lower-frequencies", "higher-frequencies", "reversed-temperatures"])
def test_strength_and_shape_mean_in_more_data_what_they_mean_in_those_that_there_are(together, name):
    """Of every cause of the library: of a resonance of the frame at 350 Hz, say, which is not moved to 3500."""
    means_the_same(together[0], together[1][name])


@pytest.mark.parametrize("name", ["lower-frequencies", "again", "random-order"])
def test_so_it_does_where_the_sweep_goes_on(at_one_temperature, name):
    means_the_same(at_one_temperature[0], at_one_temperature[1][name])


@pytest.mark.parametrize(("sweeps", "name", "begun"), [(1, "again", 7.0), (2, "reversed-temperatures", 17.0)])
def test_drift_goes_on_where_the_sweep_does(at_one_temperature, together, sweeps, name, begun):
    """A sweep is a reading a minute for six; between temperatures pass ten more, before the same one again, too."""
    further = (at_one_temperature if sweeps == 1 else together)[1][name].conditions
    share = np.asarray(further.time_in_sweep)[np.argsort(np.asarray(further.time))]
    np.testing.assert_allclose(share[: 7 * sweeps], np.tile(np.arange(7.0), sweeps) / 6.0, atol=1e-12)
    np.testing.assert_allclose(share[7 * sweeps :][:7], (begun + np.arange(7.0)) / 6.0, rtol=1e-12)


def means_the_same(problem, further):
    extensions = [Extension(cause, cause.shapes[len(cause.shapes) // 2]) for cause in DMA_CAUSES]
    when = np.asarray(further.conditions.time)
    first = np.flatnonzero(when <= np.max(np.asarray(problem.conditions.time)))
    first = first[np.argsort(when[first])]
    assert len(first) == problem.rows < further.rows
    ours = {one.name: one.directions.reshape(problem.rows, -1) for one in problem.directions(extensions)}
    order = np.argsort(np.asarray(problem.conditions.time))
    for one in further.directions(extensions):
        known = ours[one.name][order]
        np.testing.assert_allclose(
            one.directions.reshape(further.rows, -1)[first], known, atol=1e-4 * np.abs(known).max(), err_msg=one.name
        )


def test_a_resonance_of_the_frame_shows_where_readings_reach_it(together):
    """At 1.75 times the highest frequency that was measured, 350 Hz, in the decade above."""
    further = together[1]["higher-frequencies"]
    cause = next(one for one in DMA_CAUSES if one.name == "frame-resonance")
    (found,) = further.directions([Extension(cause, 1.75)])
    size = np.linalg.norm(found.directions.reshape(further.rows, -1), axis=1)
    highest = np.asarray(further.conditions.angular_frequency)[np.argmax(size)] / (2.0 * np.pi)
    assert 200.0 < highest < 500.0
