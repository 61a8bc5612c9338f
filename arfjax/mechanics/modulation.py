r"""How the radiation force of a modulated beam goes with time: Fourier series of period $1/f$.

$$ F(t) / F_{max} = \mathrm{Re} \sum_{n \ge 0} c_n e^{i n \omega t} , $$

where $F_{max}$ is the force of the beam at its strongest: the one that a continuous beam of the largest pressure
amplitude of the cycle makes. The force goes with the intensity, the square of the pressure amplitude.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float

from arfjax.errors import InputError
from arfjax.media import Scalar

Phase = Float[Array, "*time"] | Float[np.ndarray, "*time"]


class Modulation(eqx.Module):
    """Course of a force over one period."""

    @abc.abstractmethod
    def orders(self, n_harmonics: int | None) -> tuple[int, ...]:
        """Harmonics with force in them, up to a number of them if it is given."""

    @abc.abstractmethod
    def coefficients(self, n_harmonics: int) -> Complex[Array, " harmonic"]:
        """c_0 (the mean), c_1 (at the modulation frequency) up to c_n, as shares of the largest force."""

    @abc.abstractmethod
    def force(self, phase: Phase) -> Float[Array, "*time"]:
        """Force as a share of the largest at phase omega t [rad]."""

    @abc.abstractmethod
    def impulse(self, phase: Phase) -> Float[Array, "*time"]:
        """Integral of that share over phases from -pi, where the force is weakest, to `phase`, up to pi [rad]."""


class SinePressure(Modulation):
    r"""Pressure amplitude $p_{max} (1 + m \cos \omega t) / (1 + m)$: the force has a second harmonic.

    $c_0 = (1 + m^2 / 2) / (1 + m)^2$, $c_1 = 2 m / (1 + m)^2$, $c_2 = (m^2 / 2) / (1 + m)^2$.

    Attributes:
        depth: Depth m of the modulation, from 0 (continuous) to 1 (down to silence).
    """

    depth: Scalar = 1.0

    def __check_init__(self) -> None:
        """Refuse a depth that is none."""
        _require_share("depth", self.depth)

    def orders(self, n_harmonics: int | None) -> tuple[int, ...]:
        """See `Modulation`."""
        return (1, 2)[:n_harmonics]

    def coefficients(self, n_harmonics: int) -> Complex[Array, " harmonic"]:
        """See `Modulation`."""
        m = jnp.asarray(self.depth, dtype=float)
        return _padded([1.0 + 0.5 * m**2, 2.0 * m, 0.5 * m**2], n_harmonics) / (1.0 + m) ** 2

    def force(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        return ((1.0 + self.depth * jnp.cos(jnp.asarray(phase))) / (1.0 + self.depth)) ** 2

    def impulse(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        m, phase = self.depth, jnp.asarray(phase)
        tones = 2.0 * m * jnp.sin(phase) + 0.25 * m**2 * jnp.sin(2.0 * phase)
        return ((1.0 + 0.5 * m**2) * (phase + np.pi) + tones) / (1.0 + m) ** 2


class SineIntensity(Modulation):
    r"""Intensity $I_{max} (1 + m \cos \omega t) / (1 + m)$: force at one frequency only, and a mean.

    With full depth this is also the force of a pressure amplitude $p_{max} \cos(\omega t / 2)$ without carrier, the
    usual drive of harmonic motion imaging: modulated at 25 Hz, it moves the tissue at 50 Hz. Give the frequency at
    which the tissue moves.

    Attributes:
        depth: Depth m of the modulation, from 0 (continuous) to 1 (down to silence).
    """

    depth: Scalar = 1.0

    def __check_init__(self) -> None:
        """Refuse a depth that is none."""
        _require_share("depth", self.depth)

    def orders(self, n_harmonics: int | None) -> tuple[int, ...]:
        """See `Modulation`."""
        return (1,)[:n_harmonics]

    def coefficients(self, n_harmonics: int) -> Complex[Array, " harmonic"]:
        """See `Modulation`."""
        m = jnp.asarray(self.depth, dtype=float)
        return _padded([jnp.ones(()), m], n_harmonics) / (1.0 + m)

    def force(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        return (1.0 + self.depth * jnp.cos(jnp.asarray(phase))) / (1.0 + self.depth)

    def impulse(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        phase = jnp.asarray(phase)
        return (phase + np.pi + self.depth * jnp.sin(phase)) / (1.0 + self.depth)


class Square(Modulation):
    r"""Beam on for a part of each period and off for the rest; the middle of a burst is at time 0.

    $c_0 = d$ and $c_n = 2 \sin(n \pi d) / (n \pi)$: no even harmonics at a duty cycle d of one half.

    Attributes:
        duty_cycle: Part of the period in which the beam is on, from 0 to 1.
    """

    duty_cycle: Scalar = 0.5

    def __check_init__(self) -> None:
        """Refuse a duty cycle that is none."""
        _require_share("duty_cycle", self.duty_cycle)

    def orders(self, n_harmonics: int | None) -> tuple[int, ...]:
        """All up to 15 if no number is given; even ones left out at a duty cycle of exactly 0.5 (not traced)."""
        up_to = range(1, 1 + (15 if n_harmonics is None else n_harmonics))
        half = not isinstance(self.duty_cycle, Tracer) and float(self.duty_cycle) == 0.5
        return tuple(order for order in up_to if order % 2 == 1 or not half)

    def coefficients(self, n_harmonics: int) -> Complex[Array, " harmonic"]:
        """See `Modulation`."""
        d = jnp.asarray(self.duty_cycle, dtype=float)
        order = np.arange(1, n_harmonics + 1)
        tones = 2.0 * jnp.sin(np.pi * order * d) / (np.pi * order)
        return jnp.concatenate([d[None], tones]).astype(jnp.result_type(complex))

    def force(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        from_middle = jnp.abs(jnp.mod(jnp.asarray(phase) + np.pi, 2.0 * np.pi) - np.pi)
        # A beam that is never off is on in the one phase farthest from the middle, too.
        return jnp.where((from_middle < np.pi * self.duty_cycle) | (jnp.asarray(self.duty_cycle) >= 1.0), 1.0, 0.0)

    def impulse(self, phase: Phase) -> Float[Array, "*time"]:
        """See `Modulation`."""
        half = np.pi * self.duty_cycle
        return jnp.clip(jnp.asarray(phase) + half, 0.0, 2.0 * half)


def _padded(first: list[Float[Array, ""]], n_harmonics: int) -> Complex[Array, " harmonic"]:
    values = jnp.zeros(max(n_harmonics + 1, len(first)), jnp.result_type(complex))
    return values.at[: len(first)].set(jnp.stack(first))[: n_harmonics + 1]


def _require_share(name: str, value: Scalar) -> None:
    if not isinstance(value, Tracer) and not 0.0 <= float(value) <= 1.0:
        raise InputError(f"`{name}` must lie in 0 to 1, got {value}. A percentage? Divide it by 100.")
