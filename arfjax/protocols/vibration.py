"""Heated liver shaken by a modulated beam, in its steady state: what harmonic motion imaging sees.

The sound field, the lesion and the moduli are those of the stepwise protocol at one temperature. The modulus of the
solid is exact at every harmonic, without a sum of exponentials, and tissue goes on without end beyond the mesh: at 50
Hz the reflections of a box would decide the answer, because liver by the paper's constants hardly damps.

The mean of the motion is left out. It is the static answer of the relaxed shear modulus, 3 Pa in the paper's lesion
(M_0 = 8.1 Pa): it takes many relaxation times to come, and no measurement waits for it; imaging filters it out.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from arfjax.errors import InputError
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.refinement import focused_mesh
from arfjax.mechanics.harmonic.absorbing import AbsorbingLayer
from arfjax.mechanics.harmonic.motion import layer_error
from arfjax.mechanics.harmonic.periodic import solve_periodic
from arfjax.mechanics.material.harmonic import SolidField, shear_wavelength
from arfjax.mechanics.modulation import Modulation
from arfjax.media import Scalar
from arfjax.model import Model
from arfjax.protocols.discretisation import LIVER_RADIUS, Discretisation
from arfjax.protocols.heated_tissue import heated_solid, material_at_frequencies
from arfjax.protocols.stepwise import Heating, StepwiseProtocol, force_at, lesion_at, lesion_share
from arfjax.thermal.lesion import LesionSize

_ELEMENTS_A_WAVE = 6
_LAST_RESOLVED = 5
"""Harmonic whose waves elements resolve everywhere; what higher ones add to the peak-to-peak is small."""

_COARSEST = 1e-3  # m; about a lesion, motion changes within less than the liver's waves
_MOST_ELEMENTS = 16_000  # a complex factor of as many takes 4 GB


class VibrationSettings(eqx.Module):
    """How steady motion is computed.

    Attributes:
        element: Radial size of the elements about the focus [m]; axially twice that.
        coarsest: Largest size of an element [m]: a sixth of the shear waves that are to be resolved. `resolving`
            chooses it.
        n_harmonics: Highest one; the last that the modulation has, or 15, if not given.
        n_instants: Times at which the course over a period is given.
        layer: Tissue without end beyond the mesh.
    """

    element: float = eqx.field(static=True, default=0.3e-3)
    coarsest: float = eqx.field(static=True, default=0.6e-3)
    n_harmonics: int | None = eqx.field(static=True, default=None)
    n_instants: int = eqx.field(static=True, default=201)
    layer: AbsorbingLayer = AbsorbingLayer()

    def __check_init__(self) -> None:
        """Refuse what cannot be meant."""
        if not 0.0 < self.element <= self.coarsest < math.inf or self.n_instants < 2:
            raise InputError(
                "steady motion needs 0 m < `element` <= `coarsest` and two instants or more, got "
                f"{self.element} m, {self.coarsest} m and {self.n_instants}."
            )


class Vibration(eqx.Module):
    """Steady motion along the axis; at the focus Re(sum of amplitude_n exp(+i n omega t)).

    Attributes:
        harmonic: Numbers of the harmonics that the force has, from 1.
        focal_amplitude: Amplitude [m] of each at the focus; its phase is against the middle of the strongest force.
        peak_to_peak: At the focus [m], as harmonic motion imaging reports it.
        left_out: What the harmonics left out could change that by [m], if inertia rules their motion; see `vibrate`.
        r: Radii of the map [m]: the nodes of the mesh.
        z: Axial positions of the map [m].
        peak_to_peak_map: [m].
        time: From the middle of the strongest force over one period [s].
        focal_displacement: Displacement from its mean, at the focus [m].
        focal_force: Force as a share of the largest.
        lesion: What of the tissue is one.
    """

    harmonic: tuple[int, ...] = eqx.field(static=True)
    focal_amplitude: Complex[Array, " harmonic"]
    peak_to_peak: Float[Array, ""]
    left_out: Float[Array, ""]
    r: Float[np.ndarray, " r"]
    z: Float[np.ndarray, " z"]
    peak_to_peak_map: Float[Array, "r z"]
    time: Float[Array, " time"]
    focal_displacement: Float[Array, " time"]
    focal_force: Float[Array, " time"]
    lesion: LesionSize


def resolving(
    model: Model,
    temperature: float,
    settings: Discretisation,
    *,
    frequency: float,
    modulation: Modulation,
    n_harmonics: int | None = None,
    layer: AbsorbingLayer = AbsorbingLayer(),  # noqa: B008  frozen and without state
) -> VibrationSettings:
    """Settings whose elements resolve the shear waves of the last harmonic that counts; not for `jit`.

    That is the last there is, up to the fifth: of a square modulation of liver at 50 Hz the higher ones make 7 percent
    of the fundamental's motion at the focus all together, and are 3 to 9 percent wrong on such a mesh.

    Args:
        model: The model, whose constants must be numbers.
        temperature: Of the liver [degC].
        settings: Whose mesh says how fine the force is.
        frequency: Of the modulation [Hz].
        modulation: Course of the force.
        n_harmonics: Highest one, as in `VibrationSettings`.
        layer: Tissue without end beyond the mesh.

    Raises:
        InputError: if that takes more elements than fit into memory.
    """
    last = min(max(modulation.orders(n_harmonics)), _LAST_RESOLVED)
    wave = _shortest_wave(model, temperature, last * frequency)
    coarsest = min(wave / _ELEMENTS_A_WAVE, _COARSEST)
    element = min(2.0 * float(settings.mesh.r_edges[1]), coarsest)
    chosen = VibrationSettings(element=element, coarsest=coarsest, n_harmonics=n_harmonics, layer=layer)
    around = (LIVER_RADIUS + 2.0 * layer.thickness, settings.liver[1] - settings.liver[0])
    if around[0] * around[1] / coarsest**2 > 1e9 or math.prod(vibration_mesh(settings, chosen).shape) > _MOST_ELEMENTS:
        raise InputError(
            f"shear waves of {1e3 * wave:.3g} mm at {last * frequency:g} Hz need elements of {1e3 * coarsest:.2g} mm, "
            f"more than {_MOST_ELEMENTS} of them; lower the frequency, or ask for fewer harmonics."
        )
    return chosen


def vibration_mesh(settings: Discretisation, vibration: VibrationSettings) -> Mesh:
    """Elements of the liver, none larger than what resolves its waves."""
    front, back = settings.liver
    near = min(settings.focus - front, back - settings.focus, 6e-3)
    return focused_mesh(
        focus=settings.focus,
        radius=LIVER_RADIUS,
        front=front,
        back=back,
        finest_r=vibration.element,
        finest_z=min(2.0 * vibration.element, vibration.coarsest),
        fine_radius=10.0 * vibration.element,
        fine_length=2.0 * near,
        coarsest=vibration.coarsest,
    )


def vibrate(
    model: Model,
    temperature: Scalar,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    heating: Heating,
    frequency: Scalar,
    modulation: Modulation,
    vibration: VibrationSettings = VibrationSettings(),  # noqa: B008  frozen and without state
) -> Vibration:
    """Steady motion of liver at `temperature` [degC] with its lesion, under the modulated beam.

    The model's power is that of the beam at its strongest. Of sound that steepens, the force is taken to go with the
    intensity of that moment: exact for a beam that is on or off.

    Args:
        model: The model; derivatives flow to every leaf of it. Its walls and outer layer play no part.
        temperature: Of liver and focus [degC].
        protocol: Whose heating it is.
        settings: Sound field and focus; the mesh is made anew.
        heating: The sonication, which says how large the lesion is by then.
        frequency: Of the modulation, at which the force repeats [Hz].
        modulation: Course of the force over a period.
        vibration: Mesh, layer and harmonics, such as from `resolving`.

    Accuracy: peak-to-peak at the focus, the paper's case at 50 Hz, mesh of `resolving`. One harmonic: 1e-3 (against
        elements of 0.5 mm and 0.2 mm about the focus), to which the layer adds 2e-4. Square modulation with a duty
        cycle of one half, with harmonics up to N, against 31 of them on elements of 0.12 mm (for the seventh and up):

        | N | 1 | 3 | 5 | 7 | 9 | 11 | 15 | 19 | 15, mesh of `resolving` |
        | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |
        | 40 degC, no lesion | -6 % | -1.4 % | 0.4 % | 0.9 % | 0.8 % | 0.3 % | 0.05 % | -0.01 % | -0.2 % |
        | 70 degC, lesion | -7 % | -2.5 % | -1.5 % | -1.2 % | -1.0 % | -0.9 % | -0.7 % | -0.5 % | -0.9 % |

        So 15 are the default: within 1 %. `left_out` supposes that motion per force falls with the square of the
        frequency from the last harmonic on. Without a lesion it bounds the error, 5 to 20 times; beside a lesion of 70
        degC, which resonates at about 1 kHz, it gives 0.15 to 0.4 % at N = 15 where 0.7 % is missing.
    Differentiability: in the model, forward and reverse, wherever lesion and modulation have slopes; `left_out` is
        held.
    """
    mesh, solid, force, lesion = _pose(model, temperature, protocol, settings, heating, vibration)
    motion = solve_periodic(
        mesh,
        solid,
        force,
        frequency=frequency,
        modulation=modulation,
        n_harmonics=vibration.n_harmonics,
        layer=vibration.layer,
    )
    orders = modulation.orders(vibration.n_harmonics)
    time = jnp.linspace(0.0, 1.0, vibration.n_instants) / frequency
    return Vibration(
        harmonic=orders,
        focal_amplitude=motion.at_focus(settings.focus)[np.array(orders) - 1],
        peak_to_peak=motion.peak_to_peak(settings.focus),
        left_out=motion.left_out(settings.focus),
        r=mesh.node_r,
        z=mesh.node_z,
        peak_to_peak_map=motion.peak_to_peak_map,
        time=time,
        focal_displacement=motion.time_course(settings.focus, time),
        focal_force=modulation.force(2.0 * jnp.pi * frequency * time),
        lesion=lesion,
    )


def vibration_layer_error(
    model: Model,
    temperature: Scalar,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    *,
    heating: Heating,
    frequency: Scalar,
    vibration: VibrationSettings = VibrationSettings(),  # noqa: B008  frozen and without state
) -> Float[Array, ""]:
    """Error that the absorbing layer makes at the modulation frequency, as a share of the largest amplitude.

    Higher harmonics have shorter waves, which the same layer absorbs better. Arguments as of `vibrate`.
    """
    mesh, solid, force, _ = _pose(model, temperature, protocol, settings, heating, vibration)
    return layer_error(mesh, solid, force, frequency=frequency, layer=vibration.layer)


def _pose(
    model: Model,
    temperature: Scalar,
    protocol: StepwiseProtocol,
    settings: Discretisation,
    heating: Heating,
    vibration: VibrationSettings,
) -> tuple[Mesh, SolidField, Float[Array, "rq zq"], LesionSize]:
    mesh, lesion = vibration_mesh(settings, vibration), lesion_at(model, heating, temperature, settings)
    share = lesion_share(model, heating, temperature, lesion, settings, mesh)
    solid = material_at_frequencies(model, temperature, heated_solid(model, temperature, share), share.shape)
    return mesh, solid, force_at(model, temperature, protocol, settings, mesh), lesion


def _shortest_wave(model: Model, temperature: float, frequency: float) -> float:
    """Length [m] of shear waves in liver or at the lesion's centre, whichever is shorter."""

    @jax.jit  # traced, the lesion's laws do not warn where there is no lesion yet
    def lengths(at: Array) -> Array:
        solid = heated_solid(model, at, jnp.asarray([[0.0, 1.0]]))
        field = material_at_frequencies(model, at, solid, (1, 2)).at_frequency(2.0 * math.pi * frequency)
        return jnp.asarray(shear_wavelength(field, frequency))

    return float(jnp.min(lengths(jnp.asarray(temperature))))
