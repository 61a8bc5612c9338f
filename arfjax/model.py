"""The model: every assumption of the simulation in a named place of one frozen pytree."""

import math

import equinox as eqx
import jax.numpy as jnp

from arfjax import suomi2016
from arfjax.coagulation import require_transition
from arfjax.errors import InputError
from arfjax.laws import Tabulated, ViscoelasticLaw
from arfjax.mechanics.elements.mesh import Walls
from arfjax.mechanics.elements.refinement import OuterLayer
from arfjax.mechanics.material.lesion import LinearEdge, SharpEdge
from arfjax.mechanics.material.viscoelastic import ModulusReading
from arfjax.media import Scalar
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES
from arfjax.tissues import COAGULATION_WIDTH, Tissue
from arfjax.transducer import Drive, FocusedBowl


class Layer(eqx.Module):
    """A planar layer in the beam's path.

    Attributes:
        tissue: What it is made of.
        thickness: [m].
    """

    tissue: Tissue
    thickness: float = eqx.field(static=True)


class TabulatedSize(eqx.Module):
    """Size of the lesion prescribed as a function of the focal temperature, centred on the geometric focus.

    Attributes:
        length: Along the axis, tip to tip [m].
        diameter: Across the axis [m].
    """

    length: Tabulated
    diameter: Tabulated


class DoseSize(eqx.Module):
    """Size of the lesion from the contour of a thermal dose.

    Attributes:
        threshold: Dose at which tissue is taken to be coagulated [equivalent minutes at 43 degC].
    """

    threshold: Scalar = LETHAL_DOSE_MINUTES

    def __check_init__(self) -> None:
        """Refuse a dose that is none."""
        require_transition(threshold=self.threshold)


class DamageEdge(eqx.Module):
    """No ellipsoid: the share of coagulated tissue at every point is that of the thermal dose there.

    Attributes:
        width: Of the transition in the logarithm of dose.
    """

    width: Scalar = COAGULATION_WIDTH

    def __check_init__(self) -> None:
        """Refuse a transition of no width."""
        require_transition(width=self.width)


class Lesion(eqx.Module):
    """What has coagulated: an ellipsoid whose constants hold at its centre, or the shape that the dose has.

    Attributes:
        viscoelasticity: Zener constants at the centre, by temperature.
        size: Where length and diameter come from.
        edge: How the constants go from the lesion's to liver's: linearly from centre to surface as in the paper, by a
            step of some width at the surface (narrower in a lesion that is itself smaller), or by the dose itself.
            It matters: at 65 and 70 degC the paper's push moves the focus 36 and 41 percent less with a step of 0.5
            mm than linearly, and 32 and 41 percent less with the dose's own shape (lesion sized by dose).
    """

    viscoelasticity: ViscoelasticLaw
    size: TabulatedSize | DoseSize
    edge: LinearEdge | SharpEdge | DamageEdge = LinearEdge()

    def __check_init__(self) -> None:
        """Refuse an edge by dose where there is no dose."""
        if isinstance(self.edge, DamageEdge) and isinstance(self.size, TabulatedSize):
            raise InputError(
                "a lesion whose edge is that of the dose cannot have a tabulated size: take `DoseSize` or another edge."
            )


class Model(eqx.Module):
    """Transducer, tissue in the beam's path, liver and lesion.

    Attributes:
        bowl: Geometry of the transducer.
        drive: Frequency and acoustic power.
        path: Layers between bowl and liver, in the order in which sound meets them.
        liver: The last layer, which is heated and pushed.
        liver_thickness: [m].
        lesion: What heating turns the focus into.
        modulus_reading: Whether the tabulated moduli are Young's, shear or constrained moduli, which the paper does
            not say.
        poisson_ratio: Of liver and lesion, at instantaneous loading [1].
        walls: What holds the liver's surface in a push; all of it as in the paper if not given. Bottom is the front.
        outer_layer: Elements around the liver that stand for more of it, in a push; none if not given. Neither they
            nor the walls change the paper's displacement at 0.5 ms by more than 4e-6: no wave has come back by then.
    """

    bowl: FocusedBowl
    drive: Drive
    path: tuple[Layer, ...]
    liver: Tissue
    liver_thickness: float = eqx.field(static=True)
    lesion: Lesion
    modulus_reading: ModulusReading
    poisson_ratio: Scalar
    walls: Walls = Walls()
    outer_layer: OuterLayer | None = None

    @property
    def liver_depth(self) -> float:
        """Axial position of the front of the liver [m]."""
        return math.fsum(layer.thickness for layer in self.path)

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Path and liver, in the order in which sound meets them."""
        return (*self.path, Layer(self.liver, self.liver_thickness))


def tabulated_size(*, semi_axes: bool = False) -> TabulatedSize:
    """Length and diameter of the lesion from table 3 of the paper; none at 55 degC and below.

    Args:
        semi_axes: Whether the table's numbers are taken for semi-axes, so that the lesion is twice as long and wide.
    """
    columns = sorted(suomi2016.TABLE_3_LESION.items())
    source = f"{suomi2016.PAPER}, table 3"
    temperatures = jnp.asarray([55.0, *(temperature for temperature, _ in columns)])
    highest = columns[-1][0]

    def law(millimetres: list[float]) -> Tabulated:
        values = (2e-3 if semi_axes else 1e-3) * jnp.asarray([0.0, *millimetres])
        return Tabulated(temperatures, values, unit="m", source=source, valid_range=(-math.inf, highest))

    return TabulatedSize(
        law([column.length_mm for _, column in columns]), law([column.diameter_mm for _, column in columns])
    )
