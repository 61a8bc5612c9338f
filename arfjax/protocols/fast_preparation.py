"""What a `FastCurve` needs to know, found once: tables of sound, shapes of motion, points, the box of its validity."""

import dataclasses
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.reduced.basis import Shapes, reduced_force, with_points
from arfjax.mechanics.reduced.solid import ReducedSolid
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation, discretise
from arfjax.protocols.fast_curve import FEATURES, Box, FastCurve, features, same_sound
from arfjax.protocols.fast_training import push_of, seen, shapes_of
from arfjax.protocols.sound_table import (
    FieldTable,
    Interval,
    SoundTable,
    expanded,
    liver_constants,
    tabulate_fields,
)
from arfjax.protocols.stepwise import StepwiseProtocol, lesion_at

OnStep = Callable[[str, int, int], None]
"""Told what is done, how many times it has been done and how many times it is to be."""

_SMALLEST_HALF = np.array(2 * [0.0] + 6 * [0.02] + 2 * [2e-4] + [5e-4])
"""Half widths of the box below which shapes do not notice, in the units of the features; a table of sound does."""
_LENGTH, _DIAMETER = (FEATURES.index(f"lesion's {size} [m]") for size in ("length", "diameter"))
_ABSENT = -1.5
"""Where a state without a lesion lies in the box's coordinates of a lesion, -1 to 1."""
_SMALLEST_SIZE = 0.03
"""Of the largest lesion: smaller ones count as this large when pushes are chosen."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much goes into a `FastCurve`.

    Attributes:
        n_pushes: Pushes of the full solid.
        n_moments: Displacements kept of each.
        n_modes: Shapes.
        n_terms: Polynomials in each of attenuation and sound speed.
        tolerance: Of the lesion's force at the points chosen, root mean square.
        n_combinations: Of the lesion's forces that points are chosen by, half as many again as there are points.
        n_push_steps: Steps of a push of 0.5 ms, in preparation and afterwards.
        n_heat_steps: Steps of the sonication.
        small_lesions: Whether pushes are chosen by the logarithm of the lesion's size. Its beginning is then followed
            as well as the rest; without, the rest is followed better by as many pushes.
    """

    n_pushes: int = 60
    n_moments: int = 6
    n_modes: int = 60
    n_terms: int = 16
    tolerance: float = 1e-3
    n_combinations: int = 600
    n_push_steps: int = 25
    n_heat_steps: int = 90
    small_lesions: bool = False


@dataclasses.dataclass(frozen=True)
class _States:
    """All states of all draws, draw by draw; a draw has as many as the protocols ask for.

    Attributes:
        draw: Of each state.
        protocol: Of each state.
        temperature: Of each state [degC].
        values: Its features.
        present: Which of them there are.
    """

    draw: Int[np.ndarray, " state"]
    protocol: Int[np.ndarray, " state"]
    temperature: Float[np.ndarray, " state"]
    values: Float[np.ndarray, "state feature"]
    present: Bool[np.ndarray, "state feature"]


def prepare_curve(
    draws: Sequence[Model],
    protocols: Sequence[tuple[StepwiseProtocol, Float[np.ndarray, " _"]]],
    settings: Discretisation,
    *,
    heat_settings: Discretisation | None = None,
    effort: Effort = Effort(),
    on_step: OnStep = lambda what, done, of: None,
) -> FastCurve:
    """A fast model of the stepwise protocol for all models like some draws.

    What may differ from draw to draw, and afterwards: all that liver and lesion are made of in warmth and motion,
    liver's attenuation and sound speed, what conducts heat anywhere, the power if sound is linear. What may not: the
    transducer, thicknesses, all else that sound meets. What all draws share is not followed: of a liver with another
    attenuation than theirs every displacement is NaN, and its derivative in a shared one is 0.

    Args:
        draws: Models that span what will be asked for, such as 100 draws of a prior, all built alike.
        protocols: Each protocol with the temperatures of its pushes [degC]; where these are not known beforehand, some
            that span them.
        settings: Mesh of the pushes that shapes are found in. The reduced model comes as near to the full one on this
            mesh as `effort` makes it; refinement 2 or 3.
        heat_settings: Of sound and heat; `discretise` at refinement 1 if not given.
        effort: How much to put in.
        on_step: Told of the progress.

    Raises:
        InputError: if the draws differ in what may not differ, or no draw has a lesion.

    Accuracy: see `FastCurve`.
    """
    centre, *_ = draws = [jax.tree.map(jnp.asarray, draw) for draw in draws]
    coarse = discretise(centre, refinement=1.0) if heat_settings is None else heat_settings
    coarse = dataclasses.replace(coarse, n_heat_steps=effort.n_heat_steps, n_push_steps=effort.n_push_steps)
    hottest = max(float(np.max(temperatures)) for _, temperatures in protocols)
    start = protocols[0][0].start_temperature
    linear = coarse.march.n_harmonics == 1
    _check(draws, protocols, hottest, linear=linear)
    ranges = _ranges_of_sound(draws, np.linspace(start, hottest, 30), effort.n_terms)
    on_step("sound", 0, 1)
    table = tabulate_fields(centre, *ranges, path_temperature=start, heat_settings=coarse, mesh=settings.mesh)
    on_step("sound", 1, 1)
    blank = SoundTable(*ranges, heat=expanded(table.heat, *ranges), force=jnp.zeros((*table.heat.shape[:2], 0)))
    fast = FastCurve(centre, blank, _no_solid(), _no_box(), coarse, linear)
    states = _states(fast, draws, protocols, on_step)
    fast = dataclasses.replace(fast, box=_box(states, ranges))
    chosen = _far_apart(_places(states, fast.box, by_logarithm=effort.small_lesions), effort.n_pushes)
    forces = dataclasses.replace(blank, heat=expanded(table.force, *ranges))
    pushes = []
    run_of = [push_of(fast, protocol, forces, settings.mesh, effort.n_moments) for protocol, _ in protocols]
    for done, state in enumerate(chosen):
        run = run_of[states.protocol[state]]
        pushes.append(seen(run(draws[states.draw[state]], jnp.asarray(states.temperature[state]))))
        on_step("pushes", done + 1, len(chosen))
    on_step("points", 0, 1)
    shapes = shapes_of(pushes, settings, duration=protocols[0][0].push_duration, n_modes=effort.n_modes)
    samples = [sample for push in pushes for sample in push.samples]
    solid = with_points(
        settings.mesh, shapes, samples, tolerance=effort.tolerance, n_combinations=effort.n_combinations
    )
    on_step("points", 1, 1)
    force = _reduced(settings.mesh, shapes, table, ranges)
    return dataclasses.replace(fast, solid=solid, sound=dataclasses.replace(blank, force=force))


def _check(
    draws: Sequence[Model],
    protocols: Sequence[tuple[StepwiseProtocol, Float[np.ndarray, " _"]]],
    hottest: float,
    *,
    linear: bool,
) -> None:
    structure = jax.tree.structure(draws[0])
    if any(jax.tree.structure(draw) != structure for draw in draws):
        raise InputError("the draws are not all built alike: they must differ in numbers alone.")
    same = jax.jit(lambda draw: same_sound(draw, draws[0], linear=linear))
    for number, draw in enumerate(draws):
        if not bool(same(draw)):
            raise InputError(
                f"draw {number} differs from the first in the transducer, the path, or in constants of sound or of the "
                "lesion's edge that the fast curve does not follow; it follows liver's attenuation and sound speed."
            )
    starts = {protocol.start_temperature for protocol, _ in protocols}
    if len(starts) > 1:
        raise InputError(f"all sonications must start at one temperature, got {sorted(starts)} degC.")
    (start,) = starts
    liver = draws[0].liver
    for name in ("density", "absorption_exponent", "absorption_fraction"):
        values = np.asarray([getattr(liver, name)(temperature) for temperature in np.linspace(start, hottest, 5)])
        if np.ptp(values) > 1e-9 * np.max(np.abs(values)):
            raise InputError(
                f"liver's {name} changes with temperature; the fast curve's table of sound follows attenuation and "
                "sound speed only. Use the full model."
            )


def _ranges_of_sound(
    draws: Sequence[Model], temperatures: Float[np.ndarray, " t"], n_terms: int
) -> tuple[Interval, Interval]:
    constants = jax.jit(lambda draw: jax.vmap(lambda t: liver_constants(draw, t))(jnp.asarray(temperatures)))
    attenuation, speed = (np.stack(each) for each in zip(*(constants(draw) for draw in draws), strict=True))
    usable = np.all(np.isfinite(attenuation), axis=1)
    if not np.any(usable):
        raise InputError("liver's attenuation is not positive at all temperatures in any draw.")
    return Interval.around(attenuation[usable], n_terms), Interval.around(speed[usable], n_terms)


def _states(
    fast: FastCurve,
    draws: Sequence[Model],
    protocols: Sequence[tuple[StepwiseProtocol, Float[np.ndarray, " _"]]],
    on_step: OnStep,
) -> _States:
    """Features of all states of all draws; draws that make no sense are left out."""
    of_protocols = [jax.jit(_features_of(fast, *each)) for each in protocols]
    parts, broken = [], set()
    for number, draw in enumerate(draws):
        for index, (_, temperatures) in enumerate(protocols):
            values, present = (np.asarray(each) for each in of_protocols[index](draw))
            usable = np.isfinite(values) | ~present
            broken.update(FEATURES[feature] for feature in np.flatnonzero(~np.all(usable, axis=0)))
            if np.all(usable):
                count = len(temperatures)
                parts.append((np.full(count, number), np.full(count, index), np.asarray(temperatures), values, present))
        on_step("draws", number + 1, len(draws))
    if not parts:
        raise InputError(
            f"of {len(draws)} draws none can be followed: {', '.join(sorted(broken))} is not a number at some "
            "temperature in each. The constants, or the priors that they are drawn from, are none that tissue can have."
        )
    return _States(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _features_of(
    fast: FastCurve, protocol: StepwiseProtocol, temperatures: Float[np.ndarray, " step"]
) -> Callable[[Model], tuple[Array, Array]]:
    def of(draw: Model) -> tuple[Array, Array]:
        heating = fast.heating(draw, protocol)

        def of_state(temperature: Array) -> tuple[Array, Array]:
            size = lesion_at(draw, heating, temperature, fast.settings)
            return features(draw, temperature, size, protocol.push_duration)

        return jax.vmap(of_state)(jnp.asarray(temperatures, float))

    return of


def _box(states: _States, of_sound: tuple[Interval, Interval]) -> Box:
    """Ranges of the states, a twentieth wider; of what sound depends on, those of its table, which end there."""
    masked = np.where(states.present, states.values, np.nan)
    if np.all(np.isnan(masked[:, -1])):
        raise InputError("no draw has a lesion in any state: there is nothing that a fast curve would be needed for.")
    low, high = np.nanmin(masked, axis=0), np.nanmax(masked, axis=0)
    middle, half = 0.5 * (low + high), np.maximum(0.55 * (high - low), _SMALLEST_HALF)
    for place, interval in enumerate(of_sound):
        middle[place], half[place] = interval.middle, interval.half
    return Box(middle, half)


def _places(states: _States, box: Box, *, by_logarithm: bool) -> Float[np.ndarray, "state feature"]:
    """States in the box's coordinates, -1 to 1; lesions by their size or its logarithm."""
    places = np.where(states.present, (states.values - box.middle) / box.half, _ABSENT)
    if by_logarithm:
        for size in (_LENGTH, _DIAMETER):
            places[:, size] = _spread(states.values[:, size], states.present[:, size])
    return places


def _far_apart(places: Float[np.ndarray, "state feature"], count: int) -> Int[np.ndarray, " chosen"]:
    """States each of which is as far as can be from all chosen before; the first is the largest lesion."""
    chosen = [int(np.argmax(places[:, _LENGTH]))]
    distance = np.full(len(places), np.inf)
    for _ in range(min(count, len(places)) - 1):
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    return np.asarray(chosen)


def _spread(size: Float[np.ndarray, " state"], present: Bool[np.ndarray, " state"]) -> Float[np.ndarray, " state"]:
    """A lesion's size by its logarithm, from -1 to 1."""
    relative = np.where(present, size, 0.0) / np.max(size[present])
    return np.where(present, 1.0 - 2.0 * np.log(np.maximum(relative, _SMALLEST_SIZE)) / np.log(_SMALLEST_SIZE), _ABSENT)


def _reduced(
    mesh: Mesh, shapes: Shapes, table: FieldTable, ranges: tuple[Interval, Interval]
) -> Float[Array, "attenuation speed mode"]:
    reduce = jax.jit(jax.vmap(jax.vmap(lambda force: reduced_force(mesh, shapes, force))))
    return expanded(np.asarray(reduce(jnp.asarray(table.force))), *ranges)


def _no_solid() -> ReducedSolid:
    nothing = jnp.zeros((0, 0))
    return ReducedSolid(
        nothing, nothing, nothing, nothing, jnp.zeros((3, 0, 0)), nothing, nothing, *(jnp.zeros(0) for _ in range(3))
    )


def _no_box() -> Box:
    return Box(np.zeros(len(FEATURES)), np.ones(len(FEATURES)))
