"""What a march refuses before it starts, as far as values are concrete; traced ones pass."""

import math
from collections.abc import Sequence

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from arfjax.acoustics.layers import SAME_POSITION, AcousticLayer
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.base import PlaneSource, Source, concrete
from arfjax.errors import InputError, lies_within
from arfjax.transducer import Drive, PressureDrive

_POSITIVE = {"frequency", "sound_speed", "density"}
_NOT_NEGATIVE = {"acoustic_power", "attenuation"}
_BETWEEN = {
    "frequency": (1e4, math.inf, "Hz", "Megahertz? Pass hertz."),
    "density": (100.0, math.inf, "kg/m^3", "Grams per cubic centimetre? Pass kg/m^3."),
    "absorption_exponent": (0.0, 2.0, "1", "It is the power of frequency in attenuation."),
    "absorption_fraction": (0.0, 1.0, "1", "A percentage? Divide it by 100."),
}
"""Least and largest value, far outside what sound in tissue can have, unit, and what may be mistaken."""


def check_source(
    source: Source, drive: Drive | PressureDrive, layers: Sequence[AcousticLayer], settings: MarchSettings
) -> float:
    """Where the march starts [m].

    Raises:
        InputError: if the source or the settings make no sense, alone or together.
    """
    _check_numbers(source, drive, layers)
    source.check()
    thicknesses = [layer.thickness for layer in layers]
    if not thicknesses or not all(thickness > 0.0 for thickness in thicknesses):  # what is not a number, too
        raise InputError(f"`layers` need positive thicknesses [m], got {thicknesses}. Leave an absent layer out.")
    with jax.ensure_compile_time_eval():
        aperture, depth = concrete(source.aperture_radius), concrete(source.depth)
    is_given = isinstance(source, PlaneSource)
    # A field that is given may reach into the sponge: what it loses there is what leaves the beam.
    room = settings.domain_radius * (1.0 if is_given else settings.sponge_start)
    if aperture > room:
        what = "the domain ends" if is_given else "the sponge begins"
        raise InputError(
            f"the source reaches {aperture} m from the axis and must stay within {room} m, where {what}. Enlarge "
            "`domain_radius`. Millimetres? Pass metres."
        )
    start = source.plane if is_given else settings.start_plane
    if start >= thicknesses[0]:
        raise InputError(
            f"the {'plane of the source' if is_given else '`start_plane`'} at {start} m must lie inside the first "
            f"layer, which ends at {thicknesses[0]} m. Thicken the layer that holds the source: it is counted from "
            "z = 0, of a bowl the apex."
        )
    if not is_given and depth >= start:
        raise InputError(
            f"`start_plane` {start} m must lie beyond the source's foremost point, a bowl's rim, at {depth} m; two "
            "wavelengths beyond is a good choice."
        )
    wavenumber = 2.0 * math.pi * concrete(drive.frequency) / concrete(layers[0].medium.sound_speed)
    if math.pi * settings.n_radial / settings.domain_radius < wavenumber:
        at_least = math.ceil(wavenumber * settings.domain_radius / math.pi)
        raise InputError(
            f"`n_radial` {settings.n_radial} does not resolve the wavelength {2.0 * math.pi / wavenumber} m on a "
            f"domain of {settings.domain_radius} m: more than {at_least} are needed."
        )
    needed = 0.5 * wavenumber * (settings.domain_radius + aperture) + 30.0
    if not is_given and settings.n_quadrature < needed:
        raise InputError(
            f"`n_quadrature` {settings.n_quadrature} does not resolve the source's field: {needed:.0f} are needed."
        )
    return start


def check_positions(
    layers: Sequence[AcousticLayer],
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
    start: float,
    settings: MarchSettings,
) -> None:
    """Raise `InputError` where the wanted positions are not where the march passes."""
    last = sum(layer.thickness for layer in layers)
    if len(z) == 0 or not np.all(np.diff(z) > SAME_POSITION) or not np.all(np.isfinite(z)):
        raise InputError(f"`z` must hold ascending positions [m], got {z}.")
    if z[0] < start - SAME_POSITION or z[-1] > last + SAME_POSITION or z[-1] <= start + SAME_POSITION:
        raise InputError(
            f"`z` from {z[0]} to {z[-1]} m must lie between the start plane at {start} m and the end of the last layer "
            f"at {last} m, the last beyond the start plane. Millimetres? Pass metres from the bowl's apex."
        )
    clean = settings.sponge_start * settings.domain_radius
    if len(r) == 0 or not np.min(r) >= 0.0 or not np.max(r) <= clean:
        raise InputError(
            f"`r` must lie between 0 and {clean} m, where the sponge begins, got {r}. Enlarge `domain_radius`."
        )


def _check_numbers(source: Source, drive: Drive | PressureDrive, layers: Sequence[AcousticLayer]) -> None:
    """Refuse what is not finite, but for the focal length of a beam without focus, and what sound cannot have."""
    for path, leaf in jax.tree_util.tree_leaves_with_path((source, drive, [layer.medium for layer in layers])):
        name = str(getattr(path[-1], "name", path[-1]))
        if isinstance(leaf, Tracer):
            continue
        values = np.asarray(leaf)
        if not np.all(np.isfinite(values)) and not (name == "focal_length" and np.all(np.isposinf(values))):
            raise InputError(
                f"the source, its drive or a layer's medium holds a value that is not finite: `{name}` is {leaf}."
            )
        if name in _POSITIVE and not np.all(values > 0.0):
            raise InputError(f"`{name}` must be positive, got {leaf}.")
        if name in _NOT_NEGATIVE and not np.all(values >= 0.0):
            raise InputError(f"`{name}` must not be negative, got {leaf}.")
        least, largest, unit, mistaken = _BETWEEN.get(name, (-math.inf, math.inf, "", ""))
        if not lies_within(values, least, largest):
            upper = "" if largest == math.inf else f" and not above {largest:g}"
            raise InputError(f"`{name}` must not be below {least:g}{upper} [{unit}], got {leaf}. {mistaken}")
