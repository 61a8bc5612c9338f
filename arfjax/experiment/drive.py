"""How strongly the transducer is driven, whichever way an experiment file says it."""

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Float

from arfjax import tissues
from arfjax.acoustics.amplitude import drive_for_peak_pressure
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.base import Source
from arfjax.errors import InputError
from arfjax.experiment.acoustics import AcousticsSection
from arfjax.media import AcousticMedium
from arfjax.model import Layer, Model
from arfjax.numerics.compiled import compiled
from arfjax.protocols.discretisation import Discretisation
from arfjax.transducer import Drive, FocusedBowl, PressureDrive

_REACH = 0.15  # of the focal length; the parabolic operator's focus is off by half of that
_N_POSITIONS = 49
_N_ALONG_AXIS = 193


def power_of_source_pressure(model: Model, pressure: float, temperature: float) -> float:
    """Power [W] that a source pressure [Pa] sends into the first layer at a temperature [degC]."""
    return _power(model, pressure, model.path[0].tissue.acoustic(temperature))


def power_of_focal_pressure(model: Model, pressure: float, temperature: float, acoustics: AcousticsSection) -> float:
    """Power [W] with which the highest positive pressure in water is the given one [Pa].

    Sound in water is taken as nonlinear unless the file says that it is linear; harmonics and steps are those that the
    tolerance takes there.

    Raises:
        InputError: if no power makes so high a pressure, or the pressure is highest before the sound field begins.
    """
    bowl = model.bowl
    geometry = float(bowl.aperture_radius), float(bowl.hole_radius), float(bowl.focal_length)
    power = _searched(_InWater(model, geometry, float(model.drive.frequency), pressure, temperature, acoustics))
    if not math.isfinite(power):
        raise InputError(
            f"`transducer.focal_pressure_mpa` {1e-6 * pressure:g}: no drive was found that makes so high a peak in "
            "water, where shocks limit it; lower it, or give acoustic_power_w."
        )
    return power


@dataclasses.dataclass(frozen=True)
class _InWater:
    """A search in water; two are the same where all but the model are."""

    model: Model = dataclasses.field(compare=False)
    geometry: tuple[float, float, float]
    frequency: float
    pressure: float
    temperature: float
    acoustics: AcousticsSection


@functools.lru_cache(maxsize=16)
def _searched(search: _InWater) -> float:
    model, water, temperature = search.model, tissues.water(), search.temperature
    medium, focus = water.acoustic(temperature), search.geometry[2]
    model = dataclasses.replace(model, path=(Layer(water, model.liver_depth),), liver=water)
    settings = search.acoustics.start(model, nonlinear=True)
    reach = min(_REACH * focus, 0.9 * (focus - settings.march.start_plane))
    z, source = np.linspace(focus - reach, focus + reach, _N_POSITIONS), settings.source(model)
    linear_march = dataclasses.replace(settings.march, n_harmonics=1)

    def power_of(march: MarchSettings, z: Float[np.ndarray, " z"]) -> float:
        driven = compiled(
            lambda peak: drive_for_peak_pressure(
                source,
                frequency=search.frequency,
                peak_pressure=peak,
                medium=medium,
                z=z,
                diffraction=settings.diffraction,
                settings=march,
            )
        )
        return _power(model, float(np.asarray(driven(search.pressure).pressure)), medium)

    linear = power_of(linear_march, z)
    if not math.isfinite(linear):
        # A bowl that hardly focuses has its highest pressure far in front of its geometric focus.
        z = _about_the_peak(search, dataclasses.replace(settings, march=linear_march), source, medium)
        linear = power_of(linear_march, z)
    if settings.march.n_harmonics == 1:
        return linear
    # Without steepening the peak is lower: the linear drive is too strong, and what resolves its sound is enough.
    model = dataclasses.replace(model, drive=Drive(search.frequency, linear))
    return power_of(search.acoustics.discretise(model, temperature, nonlinear=True).march, z)


def _about_the_peak(
    search: _InWater, settings: Discretisation, source: FocusedBowl | Source, medium: AcousticMedium
) -> Float[np.ndarray, " z"]:
    """Positions [m] about the highest pressure of linear sound on the axis, wherever that is beyond the rim."""
    start, end = settings.march.start_plane, (1.0 + _REACH) * search.geometry[2]
    z = np.linspace(start, end, _N_ALONG_AXIS)
    field = compiled(
        lambda pressure: solve_field(
            source,
            PressureDrive(search.frequency, pressure),
            [AcousticLayer(medium, end + 1e-3)],
            r=np.zeros(1),
            z=z,
            diffraction=settings.diffraction,
            settings=settings.march,
        ).pressure[0, 0]
    )
    highest = int(np.argmax(np.abs(np.asarray(field(1e5)))))
    if highest in (0, len(z) - 1):
        raise InputError(
            f"`transducer.focal_pressure_mpa` {1e-6 * search.pressure:g}: sound of this bowl is highest at the end of "
            f"the {1e3 * start:.3g} to {1e3 * end:.3g} mm from its apex that are searched, which is no focus; give "
            "acoustic_power_w or source_pressure_kpa."
        )
    reach = min(_REACH * search.geometry[2], 0.9 * (z[highest] - start))
    return np.linspace(z[highest] - reach, z[highest] + reach, _N_POSITIONS)


def _power(model: Model, pressure: float, medium: AcousticMedium) -> float:
    return float(pressure**2 * model.bowl.area / (2.0 * medium.density * medium.sound_speed))
