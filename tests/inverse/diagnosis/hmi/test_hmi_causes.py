"""Every cause is nothing at strength 0, and its slope is that of what it does."""

import numpy as np
import pytest

from inverse.diagnosis import HMI_CAUSES

REQUIRED = (
    "thermocouple-viscous-heating thermocouple-lag thermocouple-position normalisation-temperature "
    "tracking-compression tracking-jitter thermal-decorrelation echo-strain thermal-lens path-heating "
    "attenuation-kinetics scattering-fraction exponent-change sound-speed-change perfusion conductivity-change "
    "pre-ablation-softening lesion-rim damage-law lesion-stiffness-law fractional-tissue cavitation boiling "
    "output-drift acoustic-saturation near-boundary"
).split()
SILENT = {"scattering-fraction", "boiling"}
"""A factor of all displacements, and one that needs 99 degC."""


def test_library_holds_the_names_that_users_write():
    assert [cause.name for cause in HMI_CAUSES] == list(dict.fromkeys(cause.name for cause in HMI_CAUSES))
    assert set(REQUIRED) <= {cause.name for cause in HMI_CAUSES}
    for cause in HMI_CAUSES:
        assert cause.sentence.endswith(".") and cause.helps.endswith(".") and cause.source and cause.unit
        assert cause.plausible > 0.0 and cause.sign in (0, 1) and ":" in cause.place


def at_strength(problem, cause, strength, shape=None):
    """Prediction with a strength in plausible ones, centred in each sonication."""
    program = problem.program
    unknowns = program.null()
    unknowns[program.place(cause.name)] = strength
    unknowns[len(program.causes) + program.place(cause.name)] = cause.shapes[0] if shape is None else shape
    return unknowns, program.predict(unknowns)


@pytest.mark.parametrize("cause", HMI_CAUSES, ids=lambda cause: cause.name)
def test_nothing_at_strength_0_and_something_at_a_plausible_one(problem, cause):
    plain = problem.program.predict(problem.program.null())
    for shape in cause.shapes:
        np.testing.assert_array_equal(at_strength(problem, cause, 0.0, shape)[1], plain)
    change = at_strength(problem, cause, 1.0)[1] - plain
    change -= problem.factors @ (problem.factors.T @ change / problem.factors.sum(axis=0))
    assert np.all(np.isfinite(change))
    # Plausible means: at most a few times the displacement, and more than a ten-thousandth of it somewhere.
    if cause.name in SILENT:
        assert np.max(np.abs(change)) < 1e-6
    else:
        assert 1e-4 < np.max(np.abs(change)) < 2.0


@pytest.mark.parametrize("cause", HMI_CAUSES, ids=lambda cause: cause.name)
def test_slope_is_the_central_difference(problem, cause):
    program, step = problem.program, 1e-4
    at, _ = at_strength(problem, cause, 0.05)
    slope = program.slopes(at, [program.place(cause.name)])[:, 0]
    up, down = (at_strength(problem, cause, 0.05 + sign * step)[1] for sign in (1.0, -1.0))
    central = (up - down) / (2.0 * step)
    largest = max(np.max(np.abs(slope)), 1e-6)
    np.testing.assert_allclose(slope, central, atol=1e-5 * largest)
