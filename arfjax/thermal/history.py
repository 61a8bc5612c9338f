"""What a course of temperature must be, as far as it is concrete; traced ones pass."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within

_LARGEST_TIME = 1e30  # s; infinite ones are none
_HOTTEST_START = 200.0  # degC; only the start counts, because tissue that runs away does get hotter


def require_times(time: Float[Array, " time"] | Float[np.ndarray, " time"], n_values: int) -> None:
    """Refuse times [s] that are not one a value, or of which one lies before the last.

    Raises:
        InputError: what was found.
    """
    if jnp.shape(time) != (n_values,):
        raise InputError(f"`time` has shape {jnp.shape(time)} for {n_values} temperatures; give one time for each.")
    if isinstance(time, Tracer):
        return
    times = np.asarray(time)
    if not (lies_within(times, -_LARGEST_TIME, _LARGEST_TIME) and lies_within(np.diff(times), 0.0)):
        raise InputError(f"`time` must be finite and ascend [s], got {times}; sort it, and the temperatures with it.")


def require_course(
    temperature: Float[Array, "time *space"] | Float[np.ndarray, "time *space"],
    time: Float[Array, " time"] | Float[np.ndarray, " time"],
) -> None:
    """Refuse times as `require_times` does, and temperatures [degC] that must be in kelvin.

    Raises:
        InputError: what was found.
    """
    require_times(time, len(temperature))
    if isinstance(temperature, Tracer):
        return
    with jax.ensure_compile_time_eval():  # within `jit`, a part of what is concrete would else be traced
        start = np.asarray(temperature[:1])
    if np.any(start > _HOTTEST_START):
        raise InputError(
            f"`temperature` starts at {np.max(start):g} degC, which no tissue does. Kelvin? Subtract 273.15."
        )
