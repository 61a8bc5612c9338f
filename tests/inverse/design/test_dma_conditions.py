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


@pytest.fixture(scope="module")
def together():
    """The problem, and with each decade of frequencies beside it."""
    data = as_modelled(20.0, 40.0)
    problem = dma_problem(data, FRACTIONAL)
    found = {}
    for proposal in dma_proposals(data):
        if proposal.name in ("lower-frequencies", "higher-frequencies"):
            found[proposal.name] = dma_design._further(dma_design._with(data, problem, proposal), problem, 0)
    return problem, found


@pytest.mark.parametrize("name", ["lower-frequencies", "higher-frequencies"])
def test_strength_and_shape_mean_in_more_data_what_they_mean_in_those_that_there_are(together, name):
    """Of every cause of the library: of a resonance of the frame at 350 Hz, say, which is not moved to 3500."""
    problem, further = together[0], together[1][name]
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
