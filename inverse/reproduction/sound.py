"""Sound fields on both grids at once, compiled once for all temperatures and powers."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import (
    Discretisation,
    MediumVariation,
    Model,
    StepwiseProtocol,
    heat_deposition,
    intensity,
    radiation_force_density,
)
from arfjax.protocols.discretisation import layers_at

HARMONICS = 24
"""Of nonlinear sound: enough at 90 W, where the estimated error is about 1e-3."""

_RADIUS, _RADIAL_SPACING = 3e-3, 0.05e-3  # m; grid on which a lesion's constants vary
_HALF_LENGTH, _AXIAL_SPACING = 9e-3, 0.15e-3  # m


class Maps(NamedTuple):
    """What a sound field does.

    Attributes:
        heat: Deposited in the cells of the heat grid [W/m^3].
        force: Radiation force density at the Gauss points [N/m^3].
        intensity: Of all harmonics at the Gauss points [W/m^2].
        error: Estimated error of pressure over the largest on the axis [1].
    """

    heat: Float[Array, "heat_r heat_z"]
    force: Float[Array, "rq zq"]
    intensity: Float[Array, "rq zq"]
    error: Float[Array, ""]


def field_maps(
    model: Model, protocol: StepwiseProtocol, settings: Discretisation, *, harmonics: int = 1
) -> Callable[[float, float], Maps]:
    """A compiled function of liver's temperature [degC] and acoustic power [W].

    Args:
        model: Transducer and layers; its power is not used.
        protocol: Which sets the temperature of the path.
        settings: Heat grid and mesh, whose positions are joined for one march.
        harmonics: That are carried; 1 for linear sound.
    """
    mesh, grid = settings.mesh, settings.heat_grid
    r, z = np.union1d(mesh.gauss_r, grid.r), np.union1d(mesh.gauss_z, grid.z)
    at_points = np.ix_(np.searchsorted(r, mesh.gauss_r), np.searchsorted(z, mesh.gauss_z))
    at_cells = np.ix_(np.searchsorted(r, grid.r), np.searchsorted(z, grid.z))
    settings = dataclasses.replace(settings, march=dataclasses.replace(settings.march, n_harmonics=harmonics))

    @jax.jit
    def maps(temperature: Array, power: Array) -> Maps:
        driven = dataclasses.replace(model, drive=dataclasses.replace(model.drive, acoustic_power=power))
        field = settings.sound_field(driven, layers_at(driven, temperature, protocol.start_temperature), r=r, z=z)
        carried = jnp.sum(intensity(field), axis=0)
        force, heat = radiation_force_density(field), heat_deposition(field)
        return Maps(heat[at_cells], force[at_points], carried[at_points], field.convergence.error)

    return lambda temperature, power: maps(jnp.asarray(temperature, dtype=float), jnp.asarray(power, dtype=float))


def variation_grid(settings: Discretisation) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, " z"]]:
    """Radii and axial positions [m] about the focus on which a lesion's acoustic constants may vary."""
    radii = _RADIAL_SPACING * (np.arange(round(_RADIUS / _RADIAL_SPACING)) + 0.5)
    count = round(2.0 * _HALF_LENGTH / _AXIAL_SPACING)
    return radii, settings.focus + _AXIAL_SPACING * (np.arange(count) - 0.5 * (count - 1))


def varied_force(
    model: Model, protocol: StepwiseProtocol, settings: Discretisation
) -> Callable[[float, Array, Array], Float[Array, "rq zq"]]:
    """Force density [N/m^3] of the linear field in liver whose constants vary about the focus, as a compiled function.

    Its arguments are liver's temperature [degC], and what is added to attenuation at 1 MHz [Np/m] and to sound speed
    [m/s] on `variation_grid`. The beam is attenuated and refracted by the change, and the force has its local values.
    """
    mesh = settings.mesh
    r, z = variation_grid(settings)

    @jax.jit
    def force(temperature: Array, attenuation: Array, sound_speed: Array) -> Array:
        layers = layers_at(model, temperature, protocol.start_temperature)
        variation = MediumVariation(r, z, attenuation, sound_speed)
        field = settings.sound_field(model, layers, r=mesh.gauss_r, z=mesh.gauss_z, variation=variation)
        return radiation_force_density(field)

    return lambda temperature, *changes: force(jnp.asarray(temperature, dtype=float), *map(jnp.asarray, changes))


class Overview(NamedTuple):
    """The field from the bowl's rim to the end of the liver.

    Attributes:
        r: Radii [m].
        z: Axial positions [m].
        intensity: Linear sound at 35 degC [W/m^2].
        interfaces: Axial positions [m] of the interfaces between layers.
    """

    r: Float[np.ndarray, " r"]
    z: Float[np.ndarray, " z"]
    intensity: Float[np.ndarray, "r z"]
    interfaces: tuple[float, ...]


def overview(model: Model, protocol: StepwiseProtocol, settings: Discretisation) -> Overview:
    """Linear field of the model's power through all layers, at the protocol's start temperature."""
    start = protocol.start_temperature
    interfaces = tuple(np.cumsum([layer.thickness for layer in model.layers]).tolist())
    r = np.linspace(0.0, settings.march.sponge_start * settings.march.domain_radius, 140)
    z = np.linspace(settings.march.start_plane, interfaces[-1], 240)
    field = jax.jit(lambda: intensity(settings.sound_field(model, layers_at(model, start, start), r=r, z=z)))()
    return Overview(r, z, np.asarray(jnp.sum(field, axis=0)), interfaces[:-1])
