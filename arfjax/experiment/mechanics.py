"""The sections of an experiment file that say how tissue moves: moduli, surroundings and lesion."""

from typing import Annotated, Literal

from pydantic import model_validator

from arfjax.experiment.numbers import Number, Section, between
from arfjax.mechanics.elements.mesh import Wall, Walls
from arfjax.mechanics.elements.refinement import OuterLayer
from arfjax.mechanics.material.lesion import LinearEdge, SharpEdge
from arfjax.mechanics.material.viscoelastic import ConstrainedModulus, ModulusReading, ShearModulus, YoungModulus
from arfjax.model import DamageEdge, DoseSize, Lesion, tabulated_size
from arfjax.suomi2016 import POISSON_RATIO
from arfjax.tissues import lesion_viscoelasticity

WallName = Literal["fixed", "free", "sliding"]
_SHARP_WIDTH = 0.5e-3  # m; the axial size of an element at the focus
_READINGS = {"young": YoungModulus, "shear": ShearModulus, "constrained": ConstrainedModulus}


class WallsSection(Section):
    """What holds the liver's surface: `front` faces the transducer."""

    outer: WallName = "fixed"
    front: WallName = "fixed"
    back: WallName = "fixed"


class Mechanics(Section):
    """How the moduli are to be read, and what is around the liver.

    Attributes:
        modulus: Which modulus the tabulated ones are.
        poisson_ratio: At instantaneous loading.
        walls: What holds the liver's surface, or the far end of the outer layers.
        outer_layers_mm: Thickness of layers of "infinite elements" around the liver, 5 in the paper: eight elements
            that stand for a thousand times as much tissue; none if not given. They move the walls away, and do not
            absorb. The paper's focal displacement at 0.5 ms changes by 3e-6: no wave has come back from a wall by
            then. Longer pushes feel them; `arfjax vibrate` needs neither them nor walls.
    """

    modulus: Literal["young", "shear", "constrained"] = "young"
    poisson_ratio: Annotated[Number, between(0.0, 0.49999, "", "take 0.499 for soft tissue")] = POISSON_RATIO
    walls: WallsSection = WallsSection()
    outer_layers_mm: Annotated[Number, between(0.5, 100.0, "mm", "is it in metres? Give millimetres")] | None = None

    def reading(self) -> ModulusReading:
        """Which modulus the tabulated ones are."""
        return _READINGS[self.modulus]()

    def held(self) -> Walls:
        """What holds the surface."""
        return Walls(Wall(self.walls.outer), Wall(self.walls.front), Wall(self.walls.back))

    def outer_layer(self) -> OuterLayer | None:
        """Elements around the liver."""
        return None if self.outer_layers_mm is None else OuterLayer(1e-3 * self.outer_layers_mm)


class LesionSection(Section):
    """Where the lesion is and how it ends.

    Attributes:
        size: From the contour of 240 equivalent minutes, or from the paper's table 3.
        table_sizes_are: What the table's two numbers are taken for.
        edge: How constants go from the lesion's to liver's: from centre to surface in a straight line, at the surface
            within half a millimetre, or as the dose has it at every point, without an ellipsoid.
    """

    size: Literal["dose", "table"] = "dose"
    table_sizes_are: Literal["length and diameter", "semi-axes"] = "length and diameter"
    edge: Literal["linear", "sharp", "damage"] = "linear"

    @model_validator(mode="after")
    def _choices_fit(self) -> "LesionSection":
        if self.edge == "damage" and self.size == "table":
            raise ValueError(
                'edge = "damage" takes the lesion from the computed dose, so that size = "table" cannot be; set size = '
                '"dose", or edge = "linear" or "sharp"'
            )
        if self.size == "dose" and "table_sizes_are" in self.model_fields_set:
            raise ValueError(
                f'table_sizes_are = "{self.table_sizes_are}" has no effect with size = "dose"; leave it out or set '
                'size = "table"'
            )
        return self

    def lesion(self) -> Lesion:
        """The model's lesion."""
        size = tabulated_size(semi_axes=self.table_sizes_are == "semi-axes") if self.size == "table" else DoseSize()
        edge = {"linear": LinearEdge(), "sharp": SharpEdge(_SHARP_WIDTH), "damage": DamageEdge()}[self.edge]
        return Lesion(lesion_viscoelasticity(), size, edge)
