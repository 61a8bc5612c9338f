"""How the liver's answer to radiation force is measured: by one short push, or by steady shaking."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from arfjax.errors import InputError
from arfjax.laws import Temperature
from arfjax.mechanics.elements.mesh import Mesh, interpolation_weights
from arfjax.mechanics.harmonic.periodic import solve_periodic
from arfjax.mechanics.modulation import Modulation, SineIntensity
from arfjax.mechanics.transient.push import solve_push
from arfjax.media import Scalar, Solid
from arfjax.model import Model
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.heated_tissue import material_at_frequencies, material_in_time
from arfjax.protocols.vibration import VibrationSettings, vibration_mesh


class Probe(eqx.Module):
    """A way to move tissue."""

    @abc.abstractmethod
    def mesh(self, settings: Discretisation) -> Mesh:
        """Elements on which the motion is computed."""

    @abc.abstractmethod
    def mean_force(self) -> Scalar:
        """Mean of the force over a sonication as a share of the largest, and so of the heat [1]."""

    @abc.abstractmethod
    def displacement(
        self,
        model: Model,
        solid: Solid,
        temperature: Temperature,
        force: Float[Array, "rq zq"],
        settings: Discretisation,
    ) -> Float[Array, "r z"]:
        """Axial displacement [m] that is measured, at the nodes of the mesh.

        Args:
            model: The model.
            solid: Its constants at the Gauss points of the mesh.
            temperature: Of the liver [degC], for its density.
            force: Density at the Gauss points where the beam is at its strongest [N/m^3].
            settings: Whose liver it is.
        """


class ShortPush(Probe):
    """A push beside the heating beam, which it does not weaken; displacement is that at its end.

    Attributes:
        duration: [s].
        modulation: Course of the force over it, see `PushSettings`; constant if not given.
    """

    duration: float = eqx.field(static=True, default=0.5e-3)
    modulation: Modulation | None = eqx.field(static=True, default=None)

    def __check_init__(self) -> None:
        """Refuse what is none."""
        if not 1e-5 <= self.duration <= 0.02:
            raise InputError(f"`duration` of a push must be 1e-5 to 0.02 s, got {self.duration}. Give seconds.")

    def mesh(self, settings: Discretisation) -> Mesh:
        """See `Probe`."""
        return settings.mesh

    def mean_force(self) -> Scalar:
        """See `Probe`."""
        return 1.0

    def displacement(
        self,
        model: Model,
        solid: Solid,
        temperature: Temperature,
        force: Float[Array, "rq zq"],
        settings: Discretisation,
    ) -> Float[Array, "r z"]:
        """See `Probe`."""
        material = material_in_time(model, temperature, solid, force.shape)
        steps = settings.push_steps(self.duration, self.modulation)
        return solve_push(settings.mesh, material, force, settings=steps).displacement[..., 1]


class SteadyShaking(Probe):
    """The heating beam itself, modulated; displacement is peak to peak, as harmonic motion imaging reports it.

    Heat takes seconds to change tissue and a period of the modulation 20 ms, so that motion is steady at every moment.

    Attributes:
        frequency: At which the force repeats [Hz].
        modulation: Course of the force over a period.
        vibration: Mesh, layer and harmonics, such as from `resolving`.
    """

    frequency: Scalar = 50.0
    modulation: Modulation = SineIntensity()
    vibration: VibrationSettings = VibrationSettings()

    def mesh(self, settings: Discretisation) -> Mesh:
        """See `Probe`."""
        return vibration_mesh(settings, self.vibration)

    def mean_force(self) -> Scalar:
        """See `Probe`."""
        return self.modulation.coefficients(0)[0].real

    def displacement(
        self,
        model: Model,
        solid: Solid,
        temperature: Temperature,
        force: Float[Array, "rq zq"],
        settings: Discretisation,
    ) -> Float[Array, "r z"]:
        """See `Probe`."""
        return solve_periodic(
            self.mesh(settings),
            material_at_frequencies(model, temperature, solid, force.shape),
            force,
            frequency=self.frequency,
            modulation=self.modulation,
            n_harmonics=self.vibration.n_harmonics,
            layer=self.vibration.layer,
        ).peak_to_peak_map


def on_axis_at(displacement: Float[Array, "*time r z"], mesh: Mesh, z: Scalar) -> Float[Array, "*time"]:
    """Value on the axis at `z` [m] of a displacement at the nodes of a mesh."""
    return (
        displacement[..., 0, :]
        @ interpolation_weights(jnp.asarray(mesh.z_edges, dtype=float), jnp.asarray(z, dtype=float)[None])[0]
    )
