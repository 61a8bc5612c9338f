"""The paper's protocol: a sonication taken temperature by temperature, with one short push at each.

Liver is at one uniform temperature in each step, which sets its attenuation; the lesion is as large as the dose of
the sonication up to that step has made it (or as large as a table says); a push follows, of constant force in the
paper, and the displacement at the geometric focus at its end is what the step gives.

The paper states neither the power nor the time course of the heating, but that a 60 s sonication takes the focus
from 35 to 70 degC. So the bioheat equation is solved with the heat deposition of the field at the start temperature
and scaled, exactly because it is linear, to reach the last temperature at the end of the sonication. Where sound is
nonlinear that is still the heat of the model's own power, scaled: set the power near what `Heating` says it takes.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.acoustics.checks import check_source
from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.intensity import heat_deposition
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.sources.radiating_bowl import as_source
from arfjax.errors import InputError, lies_within
from arfjax.laws import Temperature, extrapolations
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.modulation import Modulation
from arfjax.mechanics.transient.push import PushResult, PushSettings, solve_push
from arfjax.media import Scalar
from arfjax.model import Model
from arfjax.numerics.derivatives import forward_by_reverse
from arfjax.protocols.discretisation import Discretisation, layers_at
from arfjax.protocols.heated_tissue import force_on, lesion_of, push_material, share_of
from arfjax.thermal.bioheat import Phase, focal_temperature, solve_bioheat
from arfjax.thermal.dose import cumulative_equivalent_minutes
from arfjax.thermal.lesion import LesionSize

_ROUNDING = 1e-3
"""Of a temperature in single precision, after it has been scaled [K]."""


class StepwiseProtocol(eqx.Module):
    """What is done to the tissue.

    Attributes:
        start_temperature: Of all tissue and of blood at the start of the sonication [degC].
        final_temperature: At the geometric focus at the end of the sonication, above the start's [degC].
        duration: Of the sonication [s].
        push_duration: Of the push; the displacement is read at its end [s].
        modulation: Course of the force over the push, see `PushSettings`; constant if not given. The displacement is
            read where it ends, at its weakest: tissue that has come back by then shows little. Its numbers are floats.
    """

    start_temperature: float = eqx.field(static=True, default=35.0)
    final_temperature: float = eqx.field(static=True, default=70.0)
    duration: float = eqx.field(static=True, default=60.0)
    push_duration: float = eqx.field(static=True, default=0.5e-3)
    modulation: Modulation | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        """Refuse a sonication that does not heat tissue, or takes no time, and a push that takes none."""
        for name in ("start_temperature", "final_temperature"):
            if not lies_within(getattr(self, name), 0.0, 120.0):
                raise InputError(
                    f"`{name}` must lie in 0 to 120 degC, got {getattr(self, name)}. Kelvin? Subtract 273.15."
                )
        if not self.start_temperature < self.final_temperature:
            raise InputError(
                f"`final_temperature` {self.final_temperature} degC must lie above `start_temperature` "
                f"{self.start_temperature} degC: the sonication heats."
            )
        for name in ("duration", "push_duration"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"`{name}` must be positive and finite [s], got {getattr(self, name)}.")

    def push_steps(self, settings: Discretisation) -> PushSettings:
        """Time steps of a push, with which the run ends."""
        return settings.push_steps(self.push_duration, self.modulation)


class Heating(eqx.Module):
    """The sonication's course.

    Attributes:
        time: [s].
        focal_temperature: At the geometric focus [degC].
        temperature: [degC].
        dose: Since the start [equivalent minutes at 43 degC].
        acoustic_power: Power that heats so [W].
    """

    time: Float[Array, " time"]
    focal_temperature: Float[Array, " time"]
    temperature: Float[Array, "time r z"]
    dose: Float[Array, "time r z"]
    acoustic_power: Float[Array, ""]


class StepwiseResult(eqx.Module):
    """What each step gives, in the order of the temperatures asked for.

    Attributes:
        temperature: Of the liver, which is that of the focus [degC].
        time: At which the sonication gets there [s].
        displacement_history: At the geometric focus from the start to the end of the push [m].
        lesion_length: [m].
        lesion_diameter: [m].
    """

    temperature: Float[Array, " step"]
    time: Float[Array, " step"]
    displacement_history: Float[Array, "step push_time"]
    lesion_length: Float[Array, " step"]
    lesion_diameter: Float[Array, " step"]

    @property
    def displacement(self) -> Float[Array, " step"]:
        """Displacement at the geometric focus at the end of the push [m]."""
        return self.displacement_history[:, -1]


def layered_field(
    model: Model,
    temperature: Scalar,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    r: Float[np.ndarray, " r"],
    z: Float[np.ndarray, " z"],
) -> HarmonicField:
    """Sound field at radii r and depths z [m], the liver at `temperature` and the path at the start temperature."""
    return settings.sound_field(model, layers_at(model, temperature, protocol.start_temperature), r=r, z=z)


def simulate_heating(model: Model, protocol: StepwiseProtocol, settings: Discretisation) -> Heating:
    """The sonication from the start to the final temperature, with the field of the start temperature.

    Called again outside of `jit` with the same discretisation, it compiles the field anew only where numbers of the
    model differ that are no arrays.

    Raises:
        InputError: if the discretisation is none for the model's sound, constants of sound are not finite, or the
            drive does not heat.
    """
    start = protocol.start_temperature
    layers = layers_at(model, start, start)
    # Here, because within a compiled program numbers are none that could be looked at.
    check_source(as_source(settings.source(model)), model.drive, layers, settings.march)
    return heating_by(model, _heat_in(model, layers, _Known(settings)), protocol, settings)


class _Known:
    """A discretisation that a program is compiled for, whose positions have to be concrete: itself alone equals it."""

    def __init__(self, settings: Discretisation) -> None:
        self.settings = settings

    def __hash__(self) -> int:
        return id(self.settings)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Known) and other.settings is self.settings


@eqx.filter_jit
def _heat_in(model: Model, layers: Sequence[AcousticLayer], known: _Known) -> Float[Array, "r z"]:
    """Heat deposition of the model's transducer in layers [W/m^3]."""
    settings, grid = known.settings, known.settings.heat_grid
    return heat_deposition(settings.sound_field(model, layers, r=grid.r, z=grid.z))


def heating_by(
    model: Model, heat: Float[Array, "r z"], protocol: StepwiseProtocol, settings: Discretisation
) -> Heating:
    """The sonication by a given heat deposition [W/m^3] of the model's power, scaled to reach the final temperature.

    The rise is scaled with the power: NaN where tissue makes heat itself and that is traced.

    Raises:
        InputError: if there is metabolic heat, or none that warms the focus.
    """
    grid = settings.heat_grid
    start = protocol.start_temperature
    field = settings.thermal_field(model, start)
    if not lies_within(field.metabolic_heat, 0.0, 0.0):
        raise InputError(
            "tissue with metabolic heat warms up without sound, and a rise that is scaled with the power does not; "
            "simulate the sonication at its power (`run_transient`), or leave that heat out."
        )
    history = solve_bioheat(
        field,
        heat,
        grid,
        initial_temperature=start,
        arterial_temperature=start,
        phases=[Phase(protocol.duration, settings.n_heat_steps)],
    )
    focal = focal_temperature(history, grid, settings.focus)
    if not lies_within(focal[-1] - start, 0.0, above=True):
        raise InputError(
            f"the heat of {model.drive.acoustic_power} W does not warm the focus, so that it cannot be scaled to reach "
            f"{protocol.final_temperature:g} degC; give a positive `acoustic_power` and heat at the focus."
        )
    scale = (protocol.final_temperature - start) / (focal[-1] - start)
    scale = jnp.where(jnp.all(jnp.asarray(field.metabolic_heat) == 0.0), scale, jnp.nan)
    temperature = start + scale * (history.temperature - start)
    dose = cumulative_equivalent_minutes(temperature, history.time)
    power = scale * model.drive.acoustic_power
    return Heating(history.time, start + scale * (focal - start), temperature, dose, power)


def lesion_at(model: Model, heating: Heating, temperature: Scalar, settings: Discretisation) -> LesionSize:
    """The lesion when the focus reaches `temperature` [degC].

    Raises:
        InputError: if the sonication never reaches it, as far as both are concrete; traced ones are held at its ends.
    """
    return lesion_of(model, temperature, dose_at(heating, temperature), settings)


def lesion_share(
    model: Model, heating: Heating, temperature: Scalar, size: LesionSize, settings: Discretisation, mesh: Mesh
) -> Float[Array, "rq zq"]:
    """Share of the lesion at a mesh's Gauss points when the focus reaches `temperature` [degC], see `share_of`."""
    return share_of(model, size, dose_at(heating, temperature), settings, mesh)


def force_at(
    model: Model, temperature: Scalar, protocol: StepwiseProtocol, settings: Discretisation, mesh: Mesh | None = None
) -> Float[Array, "rq zq"]:
    """Radiation force density [N/m^3] at the Gauss points with the liver at `temperature` [degC].

    Args:
        model: The model.
        temperature: Of the liver [degC].
        protocol: Which sets the temperature of the path.
        settings: The sound field's discretisation.
        mesh: Whose Gauss points; those of `settings` if not given. None of the force acts outside the liver.

    Accuracy: the sound field is a sum that can be had anywhere, so that it is evaluated at the Gauss points themselves.
        On the paper's case at 35 and 70 degC (default mesh, against three times finer everything) the total force is
        then 1e-3 too large and the focal displacement 3e-4. Carried over by `arfjax.mechanics.force.force_map` from
        the cells of the heat grid, which end before the liver does, the total is 4 percent too small and the
        displacement off by 3e-4 and 7e-4; from three times as many, 1.3 percent, 3e-4 and 4e-4. A field that is known
        on a grid only, such as another program's, is what that map is for.
    """
    mesh = settings.mesh if mesh is None else mesh
    return force_on(mesh, settings, lambda r, z: layered_field(model, temperature, protocol, settings, r=r, z=z))


def push(
    model: Model,
    temperature: Scalar,
    share: Float[Array, "rq zq"],
    force: Float[Array, "rq zq"],
    protocol: StepwiseProtocol,
    settings: Discretisation,
) -> PushResult:
    """One push of liver at `temperature` [degC], of which a share is lesion, by a force density [N/m^3] on the axis."""
    mesh = settings.mesh
    material = push_material(model, temperature, share)
    return solve_push(mesh, material, force, settings=protocol.push_steps(settings))


def run_stepwise(
    model: Model,
    temperatures: Float[Array, " step"],
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    heating: Heating | None = None,
) -> StepwiseResult:
    """Displacement at the geometric focus for every temperature asked for.

    Args:
        model: The model; derivatives flow to every leaf of it.
        temperatures: Of liver and focus [degC], from the start to the final temperature of the protocol.
        protocol: What is done to the tissue.
        settings: Grids, mesh and steps; close over them under `jit`, because their positions must be concrete.
        heating: The sonication, where it has been simulated already.

    Raises:
        InputError: if a concrete temperature lies outside the protocol's.

    Accuracy: `DISPLACEMENT_ACCURACY`, with the default discretisation, on the paper's case. In float32 displacements
    are within 1e-4 of those in float64 and lesion sizes within 1e-2; gradients are stated for float64 only.
    """
    heating = simulate_heating(model, protocol, settings) if heating is None else heating
    steps, sizes = _prepare(model, temperatures, protocol, settings, heating)

    def focal_history(step: _Step) -> Array:
        return push(model, *step, protocol, settings).at_focus(settings.focus)

    # One after the other: a batch would hold the factors of every step's stiffness at once and save no time.
    histories = jax.lax.map(focal_history, steps)
    times = jax.vmap(lambda temperature: _time_of(heating, temperature))(temperatures)
    return StepwiseResult(temperatures, times, histories, sizes.length, sizes.diameter)


def stepwise_displacement(
    model: Model,
    temperatures: Float[Array, " step"],
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    heating: Heating,
) -> Float[Array, " step"]:
    """Displacement at the geometric focus at the end of each push [m], as `run_stepwise` gives it.

    For fits: its Jacobian by forward mode costs one gradient a push, however many constants are fitted.

    Raises:
        InputError: if a concrete temperature lies outside the protocol's.
    """

    def displacement(argument: tuple[Model, _Step]) -> Array:
        each, step = argument
        return push(each, *step, protocol, settings).at_focus(settings.focus)[-1]

    numbers = jax.tree.map(jnp.asarray, model)
    steps, _ = _prepare(model, temperatures, protocol, settings, heating)
    return jax.lax.map(lambda step: forward_by_reverse(displacement)((numbers, step)), steps)


_Step = tuple[Array, Array, Array]
"""Temperature, share of the lesion and force density of one or of every step."""


def _prepare(
    model: Model,
    temperatures: Float[Array, " step"],
    protocol: StepwiseProtocol,
    settings: Discretisation,
    heating: Heating,
) -> tuple[_Step, LesionSize]:
    _require_reached(temperatures, protocol.start_temperature, protocol.final_temperature)
    sizes = jax.vmap(lambda temperature: lesion_at(model, heating, temperature, settings))(temperatures)
    shares = jax.vmap(
        lambda temperature, size: lesion_share(model, heating, temperature, size, settings, settings.mesh)
    )(temperatures, sizes)
    # As one batch, because the field up to the liver is then computed once for all temperatures.
    forces = jax.vmap(lambda temperature: force_at(model, temperature, protocol, settings))(temperatures)
    return (temperatures, shares, forces), sizes


def range_notes(
    model: Model, temperature: Float[np.ndarray, " step"], lesion_length: Float[np.ndarray, " step"]
) -> list[str]:
    """What the model's laws have to say about the steps' temperatures [degC] that lie outside their range.

    The lesion's laws speak only for the steps in which there is a lesion, that is a length [m] above zero.
    """
    with_lesion = np.asarray(temperature)[np.asarray(lesion_length) > 0.0]
    return extrapolations(model.liver, temperature, name="liver") + extrapolations(
        model.lesion, with_lesion, name="lesion"
    )


def focal_temperature_at(heating: Heating, time: Float[Array, " n"]) -> Float[Array, " n"]:
    """Temperature at the geometric focus [degC] at times [s] since the start of the sonication, held at its ends."""
    return jnp.interp(time, heating.time, heating.focal_temperature)


def _time_of(heating: Heating, temperature: Scalar) -> Array:
    """When the focus reaches a temperature; it rises all the time, because the source is constant."""
    course = heating.focal_temperature
    if not isinstance(course, Tracer):
        start, *_, final = np.asarray(course)  # by NumPy, because within `jit` JAX would trace the two
        _require_reached(temperature, float(start), float(final))
    return jnp.interp(jnp.asarray(temperature), course, heating.time)


def _require_reached(temperature: Temperature, start: float, final: float) -> None:
    """Refuse concrete temperatures [degC] that a sonication does not come to: its ends would stand for them."""
    if not lies_within(temperature, start - _ROUNDING, final + _ROUNDING):
        raise InputError(
            f"the sonication takes the focus from {start:g} to {final:g} degC and never to all of "
            f"{np.asarray(temperature)} degC; ask for temperatures in between, or change the protocol's."
        )


def dose_at(heating: Heating, temperature: Scalar) -> Float[Array, "r z"]:
    """Dose in the cells of the heat grid when the focus reaches `temperature` [degC]."""
    return _interpolate_in_time(heating.dose, heating.time, _time_of(heating, temperature))


def _interpolate_in_time(values: Float[Array, "time *space"], time: Float[Array, " time"], at: Array) -> Array:
    index = jnp.clip(jnp.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    weight = (at - time[index]) / (time[index + 1] - time[index])
    return values[index] * (1.0 - weight) + values[index + 1] * weight
