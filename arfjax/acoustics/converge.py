"""The sound field to a tolerance: harmonics, Bessel terms and steps chosen by the errors that a solution estimates."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from arfjax.acoustics.diffraction import Diffraction, ExactOneWay
from arfjax.acoustics.field import Convergence, HarmonicField
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.base import Source
from arfjax.acoustics.variation import MediumVariation
from arfjax.errors import InputError
from arfjax.numerics.compiled import compiled
from arfjax.transducer import Drive, FocusedBowl, PressureDrive

_HARMONICS = (16, 24, 32, 48, 64, 96, 128, 192, 256)
_MOST_RADIAL = 1536
_MOST_ROUNDS = 12
_WANTED_COURANT_NUMBER = 0.65  # at shocks heat is what the wave loses to 3e-4 up to there


def solve_to_tolerance(
    source: FocusedBowl | Source,
    drive: Drive | PressureDrive,
    layers: Sequence[AcousticLayer],
    *,
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
    tolerance: float = 1e-3,
    diffraction: Diffraction = ExactOneWay(),  # noqa: B008  frozen and without state
    settings: MarchSettings | None = None,
    keeps_harmonics: bool = False,
    variation: MediumVariation | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[HarmonicField, MarchSettings]:
    """Nonlinear field with a discretisation that is refined until the estimated errors are below a tolerance.

    Not for `jit`, `grad` or `vmap`: it looks at numbers. Call it once and use the settings it returns with
    `solve_field` there.

    Args:
        source: The transducer.
        drive: Frequency and acoustic power, or source pressure.
        layers: From the source outwards.
        r: Radii at which the field is wanted [m].
        z: Axial positions [m].
        tolerance: Largest error of pressure over the largest on the axis; each of the three estimates of `Convergence`
            is held below it.
        diffraction: Which one-way operator.
        settings: Where to begin; by default few harmonics.
        keeps_harmonics: Whether the number of harmonics stays that of `settings`.
        variation: How constants vary within the layers.
        say: Told what is being tried.

    Returns:
        The field and the settings it was computed with. Whether the tolerance was reached says
        `field.convergence.shortcoming(tolerance)`: where a shock is thinner than 256 harmonics resolve it was not.

    Raises:
        InputError: as `solve_field`, and for a tolerance that is not between 1e-4 and 0.1.
    """
    if not 1e-4 <= tolerance <= 0.1:
        raise InputError(
            f"`tolerance` must lie between 1e-4 and 0.1, got {tolerance}: it is relative, and the end of the domain "
            "makes errors of about 1e-4 by itself."
        )
    settings = dataclasses.replace(MarchSettings(), n_harmonics=_HARMONICS[0]) if settings is None else settings

    def solve(settings: MarchSettings, r: np.ndarray, z: np.ndarray) -> HarmonicField:
        @compiled
        def run(source, drive, layers, diffraction, changes) -> HarmonicField:
            varied = None
            if variation is not None:  # its positions must stay numbers
                varied = MediumVariation(variation.r, variation.z, *changes)
            options = {"diffraction": diffraction, "settings": settings, "variation": varied}
            return solve_field(source, drive, layers, r=r, z=z, **options)

        changes = None if variation is None else (variation.attenuation, variation.sound_speed)
        return run(source, drive, list(layers), diffraction, changes)

    for _ in range(_MOST_ROUNDS):
        say(f"{settings.n_harmonics} harmonics, {settings.n_radial} terms, {1e3 * settings.axial_step:.3g} mm steps")
        found = solve(settings, np.zeros(1), z[-1:]).convergence
        if keeps_harmonics:
            found = dataclasses.replace(found, harmonics=jnp.zeros_like(found.harmonics))
        better = refined(settings, found, tolerance)
        if better == settings:
            break
        settings = better
    say(f"the field at {len(r)} x {len(z)} positions with {settings.n_harmonics} harmonics")
    return solve(settings, r, z), settings


def refined(settings: MarchSettings, found: Convergence, tolerance: float) -> MarchSettings:
    """Settings that should meet the tolerance, given what these were found to make; the same if they meet it.

    What cannot be refined any more is left.
    """
    if settings.n_harmonics > 1 and not math.isfinite(float(found.courant_number)):
        # Nothing else can be judged of a march that was not stable.
        return dataclasses.replace(settings, n_substeps=2 * settings.n_substeps)
    changes: dict = {}
    if not float(found.harmonics) <= tolerance and settings.n_harmonics > 1:
        changes["n_harmonics"] = next((n for n in _HARMONICS if n > settings.n_harmonics), settings.n_harmonics)
    if not float(found.radial) <= tolerance:
        changes["n_radial"] = min(32 * math.ceil(1.2 * settings.n_radial / 32), max(_MOST_RADIAL, settings.n_radial))
    if not float(found.axial) <= tolerance:
        wanted = 0.9 * math.sqrt(tolerance / float(found.axial)) if math.isfinite(float(found.axial)) else 0.5
        changes["axial_step"] = settings.axial_step * min(max(wanted, 0.5), 0.8)
    finer = dataclasses.replace(settings, **changes)
    if settings.n_harmonics > 1:
        grown = float(found.courant_number) * finer.n_harmonics / settings.n_harmonics
        grown *= finer.axial_step / settings.axial_step * settings.n_substeps
        finer = dataclasses.replace(finer, n_substeps=max(1, math.ceil(grown / _WANTED_COURANT_NUMBER)))
    return finer
