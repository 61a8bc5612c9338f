"""Where a beam's power goes: every watt that enters is accounted for."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from arfjax.acoustics.power import power_budget
from tests.acoustics.test_waveform import field_of


def test_budget_of_three_layers():
    field = dataclasses.replace(
        field_of(np.ones((1, 1, 1))), layer_power=jnp.asarray([[50.0, 48.0], [47.5, 40.0], [39.0, 12.0]])
    )
    budget = power_budget(field)
    np.testing.assert_allclose(budget.entering, [50.0, 47.5, 39.0])
    np.testing.assert_allclose(budget.leaving, [48.0, 40.0, 12.0])
    np.testing.assert_allclose(budget.reflected, [0.0, 0.5, 1.0])
    np.testing.assert_allclose(budget.lost, [2.0, 7.5, 27.0])
    assert float(budget.reflected.sum() + budget.lost.sum() + budget.leaving[-1]) == 50.0
