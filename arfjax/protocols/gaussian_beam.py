r"""A force without a transducer: Gaussian across and along the axis, as strong as a path through liver leaves it.

$$ F = \frac{2 \alpha(T) I_0}{c} e^{-2 \alpha(T) d} \exp(-r^2 / a^2 - (z - z_f)^2 / b^2) $$

It is what is left of the stepwise protocol where bowl, layers and diffraction are taken away, and what other codes can
compute in closed form. Attenuation acts on the path d to the focus and not within it.
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.errors import InputError, lies_within
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.media import Scalar
from arfjax.model import Model

_LARGEST = 0.1  # m; of the two lengths and the path


class GaussianBeam(eqx.Module):
    """A Gaussian focus in liver.

    Attributes:
        radius: Where across the axis the intensity has fallen to 1/e [m].
        length: Where along the axis, from the focus, it has fallen to 1/e [m].
        path: In liver, up to the focus [m].
        intensity: At the focus if nothing attenuated [W/m^2].
    """

    radius: Scalar
    length: Scalar
    path: Scalar = 20e-3
    intensity: Scalar = 1e7

    @classmethod
    def of_widths(cls, width: float, length: float, *, path: Scalar = 20e-3, intensity: Scalar = 1e7) -> "GaussianBeam":
        """From the full width and length at -6 dB, a quarter of the intensity [m]."""
        fall = 2.0 * math.sqrt(math.log(4.0))
        return cls(width / fall, length / fall, path, intensity)

    def __check_init__(self) -> None:
        """Refuse lengths that are not in metres, where they are numbers."""
        for name, smallest in (("radius", 1e-6), ("length", 1e-6), ("path", 0.0)):
            value = getattr(self, name)
            if not lies_within(value, smallest, _LARGEST):
                raise InputError(
                    f"`{name}` of a Gaussian beam must lie in {smallest:g} to {_LARGEST:g} m, got {value} m. "
                    "Millimetres? Pass metres."
                )

    def force_density(self, model: Model, temperature: Scalar, *, mesh: Mesh, focus: float) -> Float[Array, "rq zq"]:
        """Force density along the axis [N/m^3] at a mesh's Gauss points, the liver at `temperature` [degC].

        Args:
            model: Whose liver and frequency they are.
            temperature: Of the liver [degC].
            mesh: The mesh.
            focus: Axial position of the focus [m].
        """
        liver = model.liver.acoustic(temperature)
        attenuation = liver.attenuation_at(model.drive.frequency)
        intensity = self.intensity * jnp.exp(-2.0 * attenuation * self.path)
        across = jnp.exp(-((jnp.asarray(mesh.gauss_r, dtype=float) / self.radius) ** 2))
        along = jnp.exp(-(((jnp.asarray(mesh.gauss_z, dtype=float) - focus) / self.length) ** 2))
        return 2.0 * attenuation * intensity / liver.sound_speed * across[:, None] * along[None, :]
