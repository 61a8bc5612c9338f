r"""The paper's protocol in a few milliseconds a push, for posteriors: each of its physics reduced, none replaced.

The sound field is read from a table over the liver's attenuation and sound speed (`sound_table`). Bioheat equation,
dose and the lesion's size run as they are, on a grid as coarse as they allow. A push moves in a few shapes, found
beforehand in pushes of the full solid, with the liver's and the lesion's laws evaluated as they are
(`arfjax.mechanics.reduced`). So whatever is a law of liver or lesion may be fitted. What the shapes have been trained
on is a box, and outside it every displacement is NaN.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from arfjax.errors import InputError
from arfjax.laws import coagulated_fraction, log_excess
from arfjax.mechanics.elements.transfer import interpolation
from arfjax.mechanics.material.lesion import Ellipsoid
from arfjax.mechanics.material.viscoelastic import ViscoelasticField
from arfjax.mechanics.reduced.solid import ReducedSolid, reduced_push
from arfjax.media import Scalar
from arfjax.model import DamageEdge, Model, TabulatedSize
from arfjax.protocols.discretisation import Discretisation
from arfjax.protocols.heated_tissue import heated_solid, material_in_time
from arfjax.protocols.sound_table import SoundTable, liver_constants
from arfjax.protocols.stepwise import Heating, StepwiseProtocol, dose_at, heating_by, lesion_at
from arfjax.thermal.lesion import LesionSize


class Box(eqx.Module):
    """Ranges of the features of a state, see `features`, that were trained on.

    Attributes:
        middle: Of each range.
        half: Half the width of each.
    """

    middle: Float[np.ndarray, " feature"]
    half: Float[np.ndarray, " feature"]

    def excess(self, values: Float[Array, "*state feature"], present: Bool[Array, "*state feature"]) -> Array:
        """Largest distance from the middle over half the width: above 1 outside; infinite where it is no number."""
        middle, half = (jnp.broadcast_to(jnp.asarray(each), values.shape) for each in (self.middle, self.half))
        places = jnp.abs(values - middle) / half
        places = jnp.where(present, jnp.where(jnp.isnan(places), jnp.inf, places), 0.0)
        return jnp.max(places)


FEATURES = (
    "logarithm of liver's attenuation at 1 MHz [Np/m]",
    "liver's sound speed [m/s]",
    "logarithm of liver's shear modulus at once [Pa]",
    "logarithm of liver's shear modulus at the push's end [Pa]",
    "logarithm of liver's bulk modulus [Pa]",
    "logarithm of the lesion's shear modulus at once [Pa]",
    "logarithm of the lesion's shear modulus at the push's end [Pa]",
    "logarithm of the lesion's bulk modulus [Pa]",
    "lesion's length [m]",
    "lesion's diameter [m]",
    "lesion's centre [m]",
)
"""What is watched in each state; the last six where there is a lesion."""

_ALWAYS = 5


class FastCurve(eqx.Module):
    """The reduced model of one experiment; close over it under `jit`, because its positions must be concrete.

    Attributes:
        centre: Model whose transducer, path and remaining constants of sound hold throughout.
        sound: Heat and force by the liver's attenuation and sound speed.
        solid: Shapes of motion, and points of the lesion.
        box: Trained on.
        settings: Heat grid and its steps; the length of the steps of a push.
        linear_sound: Whether heat and force go with the drive's power.

    Accuracy: with 120 draws of the calibration's prior (1.3 times as wide), shapes from the mesh of refinement 2 and
        the default effort, the normalised curve of the paper's eight temperatures was within 0.32 percent points, or
        0.24 percent of its largest value, of that of refinement 3 for all of 8 fresh draws (benchmarks/inference.py).
        With 50 shapes and twice the tolerance it was within 0.53 points for 14 draws.
    Not covered: sound that the table does not follow (all but liver's attenuation and sound speed), other thicknesses,
        sonications in which heat changes the field. The box is one of ranges: in its corners, where many constants are
        extreme at once, only a comparison with the full model tells the error.
    Source: proper orthogonal decomposition and energy-conserving sampling, Farhat, Chapman & Avery, Int. J. Numer.
        Meth. Engng 102 (2015) 1077.
    """

    centre: Model
    sound: SoundTable
    solid: ReducedSolid
    box: Box
    settings: Discretisation
    linear_sound: bool = eqx.field(static=True)

    def heating(self, model: Model, protocol: StepwiseProtocol) -> Heating:
        """The sonication, as `simulate_heating` gives it with `settings`.

        Raises:
            InputError: if the model is not built as the one that this was prepared with.
        """
        require_alike(model, self.centre)
        return heating_by(model, self.heat(model, protocol), protocol, self.settings)

    def heat(self, model: Model, protocol: StepwiseProtocol) -> Float[Array, "r z"]:
        """Heat deposition at the start of the sonication [W/m^3], wherever the model is."""
        return self._power(model) * self.sound.heat_at(model, protocol.start_temperature)

    def displacement(
        self, model: Model, temperatures: Float[Array, " step"], protocol: StepwiseProtocol, *, heating: Heating
    ) -> Float[Array, " step"]:
        """Displacement at the geometric focus at the end of each push [m]; all NaN if the model is not covered.

        Args:
            model: As `centre`, but for what may differ (see `prepare_curve`).
            temperatures: Of liver and focus [degC].
            protocol: What is done to the tissue.
            heating: What `heating` gives for it.
        """
        covered = self.excess(model, temperatures, protocol, heating=heating) <= 1.0
        return jnp.where(covered, self.extrapolated(model, temperatures, protocol, heating=heating), jnp.nan)

    def extrapolated(
        self,
        model: Model,
        temperatures: Float[Array, " step"],
        protocol: StepwiseProtocol,
        *,
        heating: Heating,
        n_modes: int | None = None,
    ) -> Float[Array, " step"]:
        """As `displacement`, wherever the model is; with fewer shapes if asked for, to see what they do."""

        def displacement(temperature: Array) -> Array:
            return self.push(model, temperature, self.share(model, temperature, heating), protocol, n_modes=n_modes)

        return jax.vmap(displacement)(temperatures)

    def push(
        self,
        model: Model,
        temperature: Scalar,
        share: Float[Array, " point"],
        protocol: StepwiseProtocol,
        *,
        n_modes: int | None = None,
    ) -> Float[Array, ""]:
        """Displacement at the focus at the end of one push [m], wherever the model is.

        Args:
            model: In the state that is pushed; its laws may be other ones than those of `centre`.
            temperature: Of liver and focus [degC].
            share: Of the lesion at the points of `solid`, see `share`.
            protocol: For the push's duration.
            n_modes: How many of the shapes move; all if not given.
        """
        solid = self.solid if n_modes is None else self.solid.leading(n_modes)
        outside, inside = (_material(model, temperature, each) for each in (jnp.zeros((1, 1)), share[:, None]))
        force = self._power(model) * self.sound.force_at(model, temperature)[: solid.n_modes]
        return reduced_push(solid, outside, inside, force, protocol.push_steps(self.settings))

    def excess(
        self, model: Model, temperatures: Float[Array, " step"], protocol: StepwiseProtocol, *, heating: Heating
    ) -> Float[Array, ""]:
        """How far the model lies from the middle of what was trained on: above 1 outside, infinite if never covered."""
        states = jnp.concatenate([jnp.asarray([protocol.start_temperature], float), temperatures])

        def of_state(temperature: Array) -> tuple[Array, Array]:
            size = lesion_at(model, heating, temperature, self.settings)
            return features(model, temperature, size, protocol.push_duration)

        values, present = jax.vmap(of_state)(states)
        return jnp.where(
            same_sound(model, self.centre, linear=self.linear_sound),
            self.box.excess(jax.lax.stop_gradient(values), present),
            jnp.inf,
        )

    def share(self, model: Model, temperature: Scalar, heating: Heating) -> Float[Array, " point"]:
        """Share of the lesion at the points of `solid` when the focus reaches a temperature [degC]."""
        size = lesion_at(model, heating, temperature, self.settings)
        edge = model.lesion.edge
        r, z = self.solid.r, self.solid.z
        if not isinstance(edge, DamageEdge):
            return edge.share(Ellipsoid.of_length_and_diameter(size.length, size.diameter, centre=size.centre), r, z)
        assert not isinstance(model.lesion.size, TabulatedSize)  # `Lesion` checks it
        grid = self.settings.heat_grid
        along_r = interpolation(grid.r, np.asarray(r), degree=1, ring=True)
        along_z = interpolation(grid.z, np.asarray(z), degree=1)
        level = log_excess(dose_at(heating, temperature), model.lesion.size.threshold)
        level = jnp.sum((jnp.asarray(along_r) @ level) * jnp.asarray(along_z), axis=1)
        return coagulated_fraction(jnp.exp(level), 1.0, width=edge.width)

    def _power(self, model: Model) -> Scalar:
        return model.drive.acoustic_power / self.centre.drive.acoustic_power if self.linear_sound else 1.0


def require_alike(model: Model, centre: Model) -> None:
    """Refuse a model that differs from another in more than numbers.

    Raises:
        InputError: if it does.
    """
    if jax.tree.structure(model) != jax.tree.structure(centre):
        raise InputError(
            "the model is built otherwise than the one that the fast curve was prepared with (another law, layer or "
            "thickness): prepare it anew."
        )


def same_sound(model: Model, centre: Model, *, linear: bool) -> Bool[Array, ""]:
    """Whether all that the table of sound takes as given is the same in both, built alike; power too if not linear."""
    pairs = zip(*(jax.tree.leaves(_given(each, linear)) for each in (model, centre)), strict=True)
    same = [jnp.all(jnp.abs(jnp.asarray(a) - b) <= 1e-9 * jnp.abs(jnp.asarray(b))) for a, b in pairs]
    return jnp.all(jnp.stack(same))


def features(
    model: Model, temperature: Scalar, size: LesionSize, push_duration: float
) -> tuple[Float[Array, " feature"], Bool[Array, " feature"]]:
    """`FEATURES` of the state at a temperature [degC], and which of them there are."""
    both = _material(model, temperature, jnp.asarray([[0.0], [1.0]]))
    at_once, later = (both.relaxed_shear_modulus + _held(both, time) for time in (0.0, push_duration))
    moduli = jnp.log(jnp.stack([at_once, later, both.bulk_modulus]))[..., 0]
    sizes = jnp.stack([size.length, size.diameter, jnp.asarray(size.centre)])
    values = jnp.concatenate([jnp.stack(liver_constants(model, temperature)), moduli[:, 0], moduli[:, 1], sizes])
    return values, jnp.where(np.arange(len(FEATURES)) < _ALWAYS, True, size.length > 0.0)


def _held(field: ViscoelasticField, time: float) -> Float[Array, "rq zq"]:
    return jnp.sum(field.branch_shear_moduli * jnp.exp(-time / field.relaxation_times), axis=0)


def _material(model: Model, temperature: Scalar, share: Float[Array, "rq zq"]) -> ViscoelasticField:
    return material_in_time(model, temperature, heated_solid(model, temperature, share), share.shape)


def _given(model: Model, linear_sound: bool) -> tuple:
    """All that heat and force depend on, but liver's attenuation and sound speed (and the power of linear sound).

    And the width of the lesion's edge, which no feature of a state tells of.
    """

    def of_sound(tissue):
        return (
            tissue.density,
            tissue.absorption_exponent,
            tissue.absorption_fraction,
            None if linear_sound else tissue.nonlinearity_parameter,
        )

    path = [(of_sound(layer.tissue), layer.tissue.attenuation, layer.tissue.sound_speed) for layer in model.path]
    power = None if linear_sound else model.drive.acoustic_power
    return (model.bowl, model.drive.frequency, power, path, of_sound(model.liver), model.lesion.edge)
