"""Derivatives of what a refit leaves, by the rows' own solids and by all unknowns one after the other."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from inverse.datasets.dma import read_dma
from inverse.diagnosis import DMA_CAUSES, DmaCause
from inverse.diagnosis.dma.problem import dma_problem
from inverse.diagnosis.dma.white_residual import (
    WhiteResidual,
    plain_slope_of,
    unconstrained_constants,
    white_and_slope,
    whitened,
)
from inverse.diagnosis.noise import noise_family
from inverse.dma_fit import CONVENTIONAL, FRACTIONAL
from tests.blind import dma_generator as blind


class Filtered(DmaCause):
    """An instrument that averages over readings, so that every row has something of the one before."""

    name, place, unit, sign, plausible = "filtered", "instrument: filter", "1", 1, 0.1
    sentence = "The instrument averages over readings."
    helps = "Longer waits between readings."
    source = "assumed"
    mixes_rows = True

    def measured(self, modulus, state, strength, shape):
        return (1.0 - strength) * modulus + strength * jnp.roll(modulus, 1)


def residual_and_unknowns(folder, model, causes):
    """Of data in which temperatures are visited twice, with every cause in it at a tenth of what is plausible."""
    blind.write(folder / "data.csv", folder / "key.json", seed=5, conventional=not model.fractional)
    data = read_dma(folder / "data.csv")
    back = np.concatenate([np.arange(len(data)), np.arange(len(data) // 2)])
    later = dataclasses.replace(data.select(back), time_s=np.arange(float(len(back))))
    problem = dma_problem(later, model)
    assert np.any(np.asarray(problem.conditions.sweep_before) != np.asarray(problem.conditions.sweep))
    family = noise_family(problem.orderings(), problem.frequencies(), unit="Hz")
    noise = next(one for one in family if one.correlation and not one.is_white)
    residual = WhiteResidual(problem, causes, noise)
    shapes = [cause.shapes[len(cause.shapes) // 2] for cause in causes]
    constants = np.asarray(unconstrained_constants(residual.parameters, jnp.asarray(problem.moved))).ravel()
    unknowns = np.concatenate([np.full(len(causes), 0.1), shapes, np.clip(constants, -3.0, 3.0)])
    mask = np.ones(problem.weights.size)
    mask[10:14] = 0.0
    return residual, jnp.asarray(unknowns), jnp.asarray(mask)


@pytest.mark.parametrize(
    "causes", [DMA_CAUSES, (*DMA_CAUSES, Filtered()), ()], ids=["library", "mixed rows", "no cause"]
)
@pytest.mark.parametrize("model", [FRACTIONAL, CONVENTIONAL], ids=lambda model: model.name)
def test_slope_is_what_reverse_and_central_differences_give(tmp_path, model, causes):
    residual, unknowns, mask = residual_and_unknowns(tmp_path, model, causes)
    white, slope = white_and_slope(residual, unknowns, mask)
    np.testing.assert_allclose(white, whitened(residual, unknowns, mask), rtol=1e-10, atol=1e-12)
    reverse = jax.jit(jax.jacrev(lambda at: residual(at, mask)))(unknowns)
    largest = np.abs(np.asarray(reverse)).max()
    np.testing.assert_allclose(slope, reverse, rtol=1e-10, atol=1e-12 * largest)
    plain = jax.jit(jax.jacrev(residual.plain))(unknowns)
    np.testing.assert_allclose(plain_slope_of(residual, unknowns), plain, rtol=1e-10, atol=1e-12 * largest)
    random = np.random.default_rng(0)
    for _ in range(3):
        direction = jnp.asarray(random.standard_normal(len(unknowns)))
        ends = [whitened(residual, unknowns + step * direction, mask) for step in (1e-5, -1e-5)]
        central = np.asarray(ends[0] - ends[1]) / 2e-5
        along = np.asarray(slope @ direction)
        np.testing.assert_allclose(along, central, rtol=1e-6, atol=1e-6 * np.abs(along).max())
