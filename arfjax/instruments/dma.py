r"""Dynamic mechanical analysis of a block between platens: the modulus that it reports of a sample's own.

A drive shakes the upper platen and reads its displacement and the force that this takes; the lower platen stands on
the frame. Force over displacement, times thickness over area, is taken for the modulus of the sample. What else is
between drive and ground is in it too: drive - mass m - (sample, and bath c) - mass m_f of the frame - spring 1 / C,

$$ k(\omega) = \frac{1}{1 / (M s A / h + i \omega c) + C / (1 - C m_f \omega^2)} - m \omega^2, \qquad
   M_{\rm read} = \frac{h}{A} k(\omega) e^{i (\varphi + \omega t_d)} $$

with the time convention exp(+i omega t) and s the stiffening by platens to which the sample sticks.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Complex, Float, PRNGKeyArray

from arfjax.errors import InputError
from arfjax.instruments.sampling import require
from arfjax.media import Scalar

_LARGEST_THICKNESS, _LARGEST_AREA = 0.3, 0.1
"""[m], [m^2]; no clamp takes more, but millimetres given by their number are."""

_N_TERMS = 20
"""Terms of the series for a rectangle's pressure: the rest is 5e-8 of the first, as the fifth power goes."""

Modulus = Complex[Array, "*sample frequency"] | Complex[np.ndarray, "*sample frequency"]
AngularFrequency = Float[Array, "_"] | Float[np.ndarray, "_"]


class ModulusReadings(eqx.Module):
    """What the instrument reports.

    Attributes:
        modulus: Complex modulus with exp(+i omega t) [Pa].
        noise_floor: What noise of force and displacement adds to the mean squared magnitude, as its root [Pa].
    """

    modulus: Complex[Array, "*sample frequency"]
    noise_floor: Scalar = 0.0

    @property
    def storage(self) -> Float[Array, "*sample frequency"]:
        """Real part [Pa]: force in phase with displacement."""
        return self.modulus.real

    @property
    def loss(self) -> Float[Array, "*sample frequency"]:
        """Imaginary part [Pa]."""
        return self.modulus.imag

    @property
    def magnitude(self) -> Float[Array, "*sample frequency"]:
        """Root of the mean squared magnitude [Pa]: never below the floor; its slope is 0 where both are 0."""
        squared = self.storage**2 + self.loss**2 + self.noise_floor**2
        vanishes = squared == 0.0
        return jnp.where(vanishes, 0.0, jnp.sqrt(jnp.where(vanishes, 1.0, squared)))


class DynamicMechanicalAnalyser(eqx.Module):
    """Compression between platens, in air or in a bath; as it stands, perfect, with samples of the paper's size.

    Call it with a modulus: `analyser(modulus, angular_frequency)`.

    Attributes:
        thickness: Of the sample, h [m].
        area: Of the sample against a platen, A [m^2].
        stiffening: Of the sample by its platens, s [1]: 1 where it slips, which is how the paper reads its data, and
            `bonded_block_factor` where it sticks.
        moving_mass: Between drive and sample, with a third of the sample and what the bath adds, m [kg].
        bath_damping: Of the upper platen against the lower, in liquid, c [N s/m].
        frame_compliance: Of all that yields in series with the sample, C [m/N].
        frame_mass: That rests on this spring, m_f [kg]; the frame resonates at 1 / sqrt(C m_f) [rad/s].
        phase_error: Of force against displacement, phi [rad].
        delay: Of the channel of displacement behind that of force, t_d [s].
        noise_floor: See `ModulusReadings` [Pa].
        relative_noise: Standard deviation of the noise of one reading, relative to it, in magnitude and in phase [1].
    """

    thickness: Scalar = 10e-3
    area: Scalar = 400e-6
    stiffening: Scalar = 1.0
    moving_mass: Scalar = 0.0
    bath_damping: Scalar = 0.0
    frame_compliance: Scalar = 0.0
    frame_mass: Scalar = 0.0
    phase_error: Scalar = 0.0
    delay: Scalar = 0.0
    noise_floor: Scalar = 0.0
    relative_noise: Scalar = 0.0

    def __check_init__(self) -> None:
        """Refuse what is negative or not finite, and millimetres."""
        for name, unit in (("thickness", "m"), ("area", "m^2"), ("stiffening", "1")):
            require(name, getattr(self, name), unit, least=0.0, above=True)
        for name, unit in _NOT_NEGATIVE:
            require(name, getattr(self, name), unit, least=0.0)
        require("phase_error", self.phase_error, "rad")
        require("delay", self.delay, "s")
        _require_metres("thickness", self.thickness, _LARGEST_THICKNESS, "m")
        _require_metres("area", self.area, _LARGEST_AREA, "m^2")

    def __call__(
        self, modulus: Modulus, angular_frequency: AngularFrequency, *, key: PRNGKeyArray | None = None
    ) -> ModulusReadings:
        """What it reports of samples of a complex modulus.

        Args:
            modulus: Of the samples [Pa], at each frequency along the last axis, such as from `complex_modulus`.
            angular_frequency: [rad/s], not negative.
            key: Of the noise, drawn anew for every entry; none when None.

        Raises:
            InputError: if shapes disagree, or a frequency is negative or not finite (where not traced).

        Accuracy: exact for what the module states; waves within the sample are left out: h times the wave number must
            be small. At 10 mm and 200 Hz in tissue of 2 kPa (1.4 m/s, 7 mm a wave) it is not, in an analysis of any
            kind, and a sample of its own mass answers instead of a spring.
        Differentiability: in every attribute, the modulus and the frequencies, but at a resonance.
        """
        _require_frequencies(modulus, angular_frequency)
        omega = jnp.asarray(angular_frequency).reshape((1,) * (modulus.ndim - 1) + (-1,))
        shape = self.thickness / self.area
        sample = jnp.asarray(modulus) * self.stiffening + 1j * omega * self.bath_damping * shape
        # In moduli instead of stiffnesses, so that nothing is scaled to and fro where the instrument is perfect.
        yielding = self.frame_compliance / ((1.0 - self.frame_compliance * self.frame_mass * omega**2) * shape)
        read = sample / (1.0 + sample * yielding) - self.moving_mass * omega**2 * shape
        read = read * jnp.exp(1j * (self.phase_error + omega * self.delay))
        if key is not None:
            parts = jax.random.normal(key, (2, *read.shape), read.real.dtype)
            read = read * (1.0 + self.relative_noise * jax.lax.complex(parts[0], parts[1]))
        return ModulusReadings(read, self.noise_floor)


_NOT_NEGATIVE = (
    ("moving_mass", "kg"),
    ("bath_damping", "N s/m"),
    ("frame_compliance", "m/N"),
    ("frame_mass", "kg"),
    ("noise_floor", "Pa"),
    ("relative_noise", "1"),
)


def mean_of_magnitudes(
    magnitudes: Float[Array, "sample *rest"] | Float[np.ndarray, "sample *rest"],
) -> tuple[Float[Array, "*rest"], Float[Array, "*rest"]]:
    """Mean magnitude over samples and its standard error, as the paper averages its five.

    Raises:
        InputError: if there are not two samples or more.
    """
    n_samples = len(magnitudes)
    if n_samples < 2:
        raise InputError(f"a standard error needs two samples or more along the first axis, got {n_samples}.")
    deviations = jnp.asarray(magnitudes) - jnp.mean(magnitudes, axis=0, keepdims=True)
    squared = jnp.sum(deviations**2, axis=0) / (n_samples * (n_samples - 1.0))
    alike = squared == 0.0
    return jnp.mean(magnitudes, axis=0), jnp.where(alike, 0.0, jnp.sqrt(jnp.where(alike, 1.0, squared)))


def magnitude_of_mean(
    modulus: Complex[Array, "sample *rest"] | Complex[np.ndarray, "sample *rest"],
) -> Float[Array, "*rest"]:
    """Magnitude [Pa] of the mean complex modulus: below the mean of the magnitudes where samples differ in phase."""
    return jnp.abs(jnp.mean(jnp.asarray(modulus), axis=0))


def bonded_block_factor(*, width: Scalar, depth: Scalar, thickness: Scalar) -> Float[Array, ""]:
    r"""Apparent over true Young's modulus of an incompressible block that sticks to its platens.

    The block bulges as a parabola, which takes a pressure like that of a viscous film; its mean is that of Prandtl's
    stress function of torsion, which for a rectangle a by b <= a is

    $$ \frac{E_a}{E} = 1 + \frac{b^2}{3 h^2} \left(1 - \frac{192 b}{\pi^5 a} \sum_{n = 1, 3, ...}
       \frac{\tanh(n \pi a / 2 b)}{n^5}\right) $$

    A square has 1 + 2.25 S^2 with the shape factor S, loaded over free area; a disc has 1 + 2 S^2 in the same way.

    Args:
        width: One side of the block [m].
        depth: The other [m].
        thickness: Between the platens [m].

    Raises:
        InputError: if one is not a positive number.

    Accuracy: for blocks not much longer than wide; long strips are stiffer by up to 4/3, because their uniform part is
        plane strain. A disc's 1 + 2 S^2 against finite elements at a Poisson ratio of 0.49999: 6 % too low at S = 1/4
        and 3 % at 1/2 (the paper's block), where the bulge is no parabola (Horton et al.), 1.5 % too high at 1 and 3 %
        at 2. A Poisson ratio of 0.49 takes 3 % off the true factor at S = 1/2, 11 % at 1, a third at 2.
    Differentiability: everywhere but in the sides of a square, where they change places; there is no jump of slope.
    Source: Gent & Lindley, Proc. Inst. Mech. Eng. 173 (1959) 111 (the argument; 1 + 2 S^2 for unfilled rubber, disc or
        square); Timoshenko & Goodier, Theory of Elasticity, torsion of a rectangle (the series); Horton, Tupholme &
        Gover, J. Appl. Mech. 69 (2002) 836 (where the parabola fails).
    """
    for name, value in (("width", width), ("depth", depth), ("thickness", thickness)):
        require(name, value, "m", least=0.0, above=True)
    long, short = jnp.maximum(width, depth), jnp.minimum(width, depth)
    odd = 2.0 * np.arange(_N_TERMS) + 1.0
    series = jnp.sum(jnp.tanh(0.5 * np.pi * odd * long / short) / odd**5)
    pressure = (short / thickness) ** 2 / 3.0 * (1.0 - 192.0 / np.pi**5 * short / long * series)
    return 1.0 + pressure


def _require_metres(name: str, value: Scalar, largest: float, unit: str) -> None:
    if not isinstance(value, Tracer) and np.any(np.asarray(value) > largest):
        raise InputError(f"`{name}` is {value:g} {unit}. Millimetres? Pass {unit}.")


def _require_frequencies(modulus: Modulus, angular_frequency: AngularFrequency) -> None:
    if modulus.shape[-1] != len(angular_frequency):
        raise InputError(
            f"`modulus` has shape {modulus.shape} for {len(angular_frequency)} frequencies; its last axis is frequency."
        )
    if isinstance(angular_frequency, Tracer):
        return
    if not (np.all(np.isfinite(angular_frequency)) and np.all(np.asarray(angular_frequency) >= 0.0)):
        raise InputError("`angular_frequency` must be finite and not negative [rad/s]; correct it.")
