"""The model: every assumption of the simulation in a named place of one frozen pytree."""

import math

import equinox as eqx
import jax.numpy as jnp

from arfjax import suomi2016
from arfjax.laws import Tabulated, ViscoelasticLaw
from arfjax.mechanics.material.viscoelastic import ShearModulus, YoungModulus
from arfjax.media import Scalar
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES
from arfjax.tissues import Tissue
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


class Lesion(eqx.Module):
    """The coagulated ellipsoid: its constants hold at its centre and fall linearly to liver's at its edge.

    Attributes:
        viscoelasticity: Zener constants at the centre, by temperature.
        size: Where length and diameter come from.
    """

    viscoelasticity: ViscoelasticLaw
    size: TabulatedSize | DoseSize


class Model(eqx.Module):
    """Transducer, tissue in the beam's path, liver and lesion.

    Attributes:
        bowl: Geometry of the transducer.
        drive: Frequency and acoustic power.
        path: Layers between bowl and liver, in the order in which sound meets them.
        liver: The last layer, which is heated and pushed.
        liver_thickness: [m].
        lesion: What heating turns the focus into.
        modulus_reading: Whether the tabulated moduli are Young's or shear moduli, which the paper does not say.
        poisson_ratio: Of liver and lesion, at instantaneous loading [1].
    """

    bowl: FocusedBowl
    drive: Drive
    path: tuple[Layer, ...]
    liver: Tissue
    liver_thickness: float = eqx.field(static=True)
    lesion: Lesion
    modulus_reading: YoungModulus | ShearModulus
    poisson_ratio: Scalar

    @property
    def liver_depth(self) -> float:
        """Axial position of the front of the liver [m]."""
        return math.fsum(layer.thickness for layer in self.path)

    @property
    def layers(self) -> tuple[Layer, ...]:
        """Path and liver, in the order in which sound meets them."""
        return (*self.path, Layer(self.liver, self.liver_thickness))


def tabulated_size() -> TabulatedSize:
    """Length and diameter of the lesion from table 3 of the paper; none at 55 degC and below."""
    columns = sorted(suomi2016.TABLE_3_LESION.items())
    source = f"{suomi2016.PAPER}, table 3"
    temperatures = jnp.asarray([55.0, *(temperature for temperature, _ in columns)])
    highest = columns[-1][0]

    def law(millimetres: list[float]) -> Tabulated:
        values = 1e-3 * jnp.asarray([0.0, *millimetres])
        return Tabulated(temperatures, values, unit="m", source=source, valid_range=(-math.inf, highest))

    return TabulatedSize(
        law([column.length_mm for _, column in columns]), law([column.diameter_mm for _, column in columns])
    )
