"""A sonication with its feedback: heat changes tissue, changed tissue changes the field, the field changes the heat.

Attenuation, sound speed and thermal constants of every cell follow its temperature and dose through the model's laws.
The sound field is computed again whenever the temperature of any cell has moved by a tolerance. With an infinite
tolerance the field stays that of the start, the paper's way.
"""

from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import heat_deposition
from arfjax.model import DoseSize, Model
from arfjax.protocols.discretisation import Discretisation, layers_at
from arfjax.thermal.adaptive import solve_adaptively
from arfjax.thermal.bioheat import Phase, TemperatureHistory, boiling_time, focal_temperature
from arfjax.thermal.conduction import Walls
from arfjax.thermal.damage import LETHAL_DOSE_MINUTES, ArrheniusDamage, DamageLaw, accumulated_damage
from arfjax.thermal.feedback import FROZEN, Effort, solve_with_feedback
from arfjax.thermal.lesion import LesionSize, lesion_growth


class FixedSteps(eqx.Module):
    """Steps as the phases state them."""


class AdaptiveSteps(eqx.Module):
    """Steps as long as an error allows; the ends of the phases' steps are the output times.

    Attributes:
        error: Largest error of temperature that the first stage of a step may make [K].
        mode: Which derivatives can be taken.
    """

    error: float = eqx.field(static=True, default=0.05)
    mode: Literal["reverse", "forward"] = eqx.field(static=True, default="reverse")


class Sonication(eqx.Module):
    """What is done to the tissue.

    Attributes:
        phases: Heating and cooling, one after the other; powers are factors on the heat of the drive's acoustic power,
            which where sound is nonlinear is not the heat of that other power.
        start_temperature: Of all tissue and of blood [degC].
        field_tolerance: How far temperature may move anywhere before the field is computed again [K]; infinite for
            the field of the start throughout.
    """

    phases: tuple[Phase, ...]
    start_temperature: float = eqx.field(static=True, default=37.0)
    field_tolerance: float = eqx.field(static=True, default=FROZEN)


class SonicationResult(eqx.Module):
    """Course of a sonication, at its output times.

    Attributes:
        time: [s].
        focal_temperature: At the geometric focus [degC].
        temperature: [degC].
        dose: CEM43 [equivalent min at 43 degC].
        damage: By the other law, from the temperatures at the output times [in its unit].
        lesion: Size of the region that has reached the model's lethal dose.
        heat: Heat deposition before each output time but the start [W/m^3].
        field_updates: How often the field had been computed again by each of these times.
        boiling_time: First output time at which 100 degC are reached [s], NaN if never: see `boiling_time`.
        effort: Steps, their largest error, and whether the end was reached.
    """

    time: Float[Array, " time"]
    focal_temperature: Float[Array, " time"]
    temperature: Float[Array, "time r z"]
    dose: Float[Array, "time r z"]
    damage: Float[Array, "time r z"]
    lesion: LesionSize
    heat: Float[Array, "step r z"]
    field_updates: Array
    boiling_time: Float[Array, ""]
    effort: Effort


def sonicate(
    model: Model,
    sonication: Sonication,
    settings: Discretisation,
    *,
    steps: FixedSteps | AdaptiveSteps = FixedSteps(),  # noqa: B008  frozen and without state
    damage_law: DamageLaw = ArrheniusDamage(),  # noqa: B008
    walls: Walls | None = None,
) -> SonicationResult:
    """Temperature, dose, damage and lesion of a sonication.

    Args:
        model: The model; derivatives flow to every leaf of it.
        sonication: What is done to the tissue.
        settings: Grids and steps of the field; close over them under `jit`, because their positions must be concrete.
        steps: Fixed or adaptive in time.
        damage_law: Reported beside thermal dose.
        walls: All at the start temperature when None.

    Accuracy: second order in the time step; the field up to `field_tolerance` late. What the field misses of a change
    of tissue is stated in `arfjax.acoustics.variation`. Nothing boils: see `boiling_time` of the result.
    Differentiability: forward and reverse, as `solve_with_feedback` and `solve_adaptively` say.
    """
    start, grid = sonication.start_temperature, settings.heat_grid

    def source(temperature: Float[Array, "r z"], dose: Float[Array, "r z"]) -> Float[Array, "r z"]:
        field = sonication_field(model, sonication, settings, temperature, dose, r=grid.r, z=grid.z)
        return heat_deposition(field)

    solver, options = solve_with_feedback, {}
    if isinstance(steps, AdaptiveSteps):
        solver, options = solve_adaptively, {"error": steps.error, "mode": steps.mode}
    history = solver(
        lambda temperature, dose: settings.thermal_field(model, temperature, dose),
        source,
        grid,
        phases=sonication.phases,
        initial_temperature=start,
        arterial_temperature=start,
        tolerance=sonication.field_tolerance,
        walls=walls,
        **options,
    )
    course = TemperatureHistory(history.time, history.temperature)
    # A lesion whose size comes from a table states no dose of its own.
    size = model.lesion.size
    threshold = size.threshold if isinstance(size, DoseSize) else LETHAL_DOSE_MINUTES
    return SonicationResult(
        time=history.time,
        focal_temperature=focal_temperature(course, grid, settings.focus),
        temperature=history.temperature,
        dose=history.dose,
        damage=accumulated_damage(damage_law, history.temperature, history.time),
        lesion=lesion_growth(history.dose, grid, threshold=threshold),
        heat=history.heat,
        field_updates=history.updates,
        boiling_time=boiling_time(course, grid),
        effort=history.effort,
    )


def sonication_field(
    model: Model,
    sonication: Sonication,
    settings: Discretisation,
    temperature: Float[Array, "heat_r heat_z"],
    dose: Float[Array, "heat_r heat_z"],
    *,
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
) -> HarmonicField:
    """Sound field at radii r and depths z [m] in tissue of these temperatures [degC] and doses [min]."""
    start = sonication.start_temperature
    variation = settings.acoustic_variation(model, temperature, dose, reference=start)
    return settings.sound_field(model, layers_at(model, start, start), r=r, z=z, variation=variation)
