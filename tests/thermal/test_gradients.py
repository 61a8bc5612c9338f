"""Derivatives of what is measured (focal temperature, dose, lesion) in what tissue and heat are; batches."""

import jax
import jax.numpy as jnp
import numpy as np

from arfjax.grid import AxisymmetricGrid
from arfjax.media import ThermalMedium
from arfjax.thermal.bioheat import Convective, Phase, ThermalField, Walls, focal_temperature, solve_bioheat
from arfjax.thermal.dose import cumulative_equivalent_minutes
from arfjax.thermal.lesion import lesion_size

GRID = AxisymmetricGrid(8e-3 * np.linspace(0.0, 1.0, 9) ** 1.3, np.linspace(0.09, 0.11, 15))
LIVER = ThermalMedium(0.51, 3.8e6, 3.6e4)
SHAPE = np.exp(-((GRID.r[:, None] / 2e-3) ** 2) - ((GRID.z[None, :] - 0.1) / 5e-3) ** 2)


def start() -> dict:
    ones = np.random.default_rng(3).uniform(0.8, 1.2, (3, *GRID.shape))
    return {
        "field": ThermalField(0.51 * ones[0], 3.8e6 * ones[1], 3.6e4 * ones[2], 1e4),
        "heat": 1.3e7 * SHAPE,
        "initial": 37.0,
        "arterial": 36.5,
        "wall": 0.5,
        "transfer": 300.0,
        "heating": 14.0,
        "cooling": 6.0,
        "idle_power": 0.1,
    }


def history(model):
    return solve_bioheat(
        model["field"],
        model["heat"],
        GRID,
        initial_temperature=model["initial"],
        arterial_temperature=model["arterial"],
        phases=[Phase(model["heating"], 14), Phase(model["cooling"], 6, model["idle_power"])],
        walls=Walls(outer=Convective(model["transfer"], model["wall"])),
    )


def quantities(model):
    """Focal temperature, logarithm of dose, length of the lesion."""
    result = history(model)
    dose = cumulative_equivalent_minutes(result.temperature, result.time)[-1]
    focal = jnp.sum(focal_temperature(result, GRID, 0.0993)[1:])
    return jnp.stack([focal, jnp.sum(jnp.log(dose[:2, 5:9])), 1e3 * lesion_size(dose, GRID).length])


def one_leaf_at_a_time(model) -> list:
    """Directions: a random change of each property alone."""
    leaves, structure = jax.tree.flatten(jax.tree.map(jnp.asarray, model))
    rng = np.random.default_rng(4)
    changes = [0.1 * leaf * (1.0 + rng.uniform(size=leaf.shape)) for leaf in leaves]
    return [
        structure.unflatten([change if i == j else jnp.zeros_like(change) for j, change in enumerate(changes)])
        for i in range(len(leaves))
    ]


def test_derivatives_of_every_quantity_in_every_property():
    """Reverse = forward (1e-10) = central difference (1e-6), for each pair of a quantity and a property."""
    model = jax.tree.map(jnp.asarray, start())
    directions = one_leaf_at_a_time(model)
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *directions)
    value = jax.jit(quantities)
    forward = jax.jit(jax.vmap(lambda direction: jax.jvp(quantities, (model,), (direction,))[1]))(stacked)
    rows = jax.jit(jax.jacrev(quantities))(model)
    products = jax.tree.map(
        lambda row, change: jnp.einsum("qn,dn->dq", row.reshape(3, -1), change.reshape(len(directions), -1)),
        rows,
        stacked,
    )
    reverse = sum(jax.tree.leaves(products))
    assert np.all(np.abs(forward) > 1e-6)
    np.testing.assert_allclose(reverse, forward, rtol=1e-10)
    for direction, derivative in zip(directions, forward, strict=True):

        def along(length, direction=direction):
            return value(jax.tree.map(lambda leaf, change: leaf + length * change, model, direction))

        step = 2e-3
        central = (8.0 * (along(step) - along(-step)) - (along(2.0 * step) - along(-2.0 * step))) / (12.0 * step)
        np.testing.assert_allclose(derivative, central, rtol=1e-6)


def test_lesion_is_there():
    result = history(start())
    size = lesion_size(cumulative_equivalent_minutes(result.temperature, result.time)[-1], GRID)
    assert 2e-3 < float(size.length) < 0.015 and 1e-3 < float(size.diameter) < 8e-3


def test_a_batch_matches_a_loop():
    scales = jnp.asarray([0.7, 1.0, 1.3])

    def focal(scale):
        model = start()
        field = jax.tree.map(lambda leaf: scale * leaf, model["field"])
        result = history(model | {"field": field, "initial": 36.0 + scale})
        return result.temperature

    batch = jax.jit(jax.vmap(focal))(scales)
    loop = jnp.stack([focal(scale) for scale in scales])
    np.testing.assert_allclose(batch, loop, rtol=1e-12)
