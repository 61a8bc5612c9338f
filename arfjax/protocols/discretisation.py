"""Grids, mesh and steps on which a protocol runs, made for one geometry."""

import math
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax.acoustics.diffraction import Diffraction, ExactOneWay
from arfjax.acoustics.field import HarmonicField
from arfjax.acoustics.layers import AcousticLayer
from arfjax.acoustics.one_way import solve_field
from arfjax.acoustics.settings import MarchSettings
from arfjax.acoustics.sources.base import Source
from arfjax.acoustics.sources.projected_bowl import ProjectedBowl
from arfjax.acoustics.variation import MediumVariation
from arfjax.errors import InputError
from arfjax.grid import AxisymmetricGrid, graded_positions
from arfjax.laws import Temperature
from arfjax.mechanics.elements.mesh import Mesh
from arfjax.mechanics.elements.refinement import OuterLayer
from arfjax.mechanics.modulation import Modulation
from arfjax.mechanics.transient.push import PushSettings
from arfjax.model import Layer, Model
from arfjax.thermal.bioheat import ThermalField
from arfjax.transducer import FocusedBowl

LIVER_RADIUS = 21e-3  # m; the paper's liver is 42 mm wide
RIM_TO_START = 3.2e-3  # m; from the bowl's rim to the march's start
RIM_TO_HEAT = 5e-3  # m; from the bowl's rim to the first heated cell
_SAME_FACE = 1e-6  # m; an interface as near to a wall as that is the wall
HEAT_REACH = 20e-3  # m; heat spreads sqrt(4 D t) = 6 mm in 60 s, so the walls are three times further than it gets
# Beyond minutes walls that stay as warm as at the start cool tissue without blood flow: see `discretise`.


DISPLACEMENT_ACCURACY = 3e-3
"""Relative error of the focal displacement that the default spacings and steps make on the paper's case, measured
against three times finer ones everywhere; the normalised curve is within 0.2 percent points. For another transducer
the finest spacings shrink with its beam; refine once and compare to know the error there."""


class Discretisation(eqx.Module):
    """Grids, mesh and steps; `discretise` makes them to `DISPLACEMENT_ACCURACY`.

    Attributes:
        focus: Axial position at which displacement and temperature are read: the geometric focus [m].
        heat_grid: Cells of the bioheat equation.
        mesh: Elements of the liver, and of the layer around it if there is one.
        march: Settings of the sound field's march; linear sound if it carries one harmonic.
        n_heat_steps: Time steps of the sonication.
        n_push_steps: Time steps of a push of 0.5 ms; a longer one takes more of the same length.
        diffraction: The sound field's one-way operator.
        source_plane: Where the bowl's converging wave is given, as other codes have it [m]; None for its true
            radiation.
        shortcoming: What keeps the sound field from its tolerance, in words; empty if nothing does.
        outer_layer: Of the mesh; no force acts in it.
    """

    focus: float = eqx.field(static=True)
    heat_grid: AxisymmetricGrid
    layer_of_cell: tuple[int, ...] = eqx.field(static=True)
    mesh: Mesh
    march: MarchSettings
    n_heat_steps: int = eqx.field(static=True)
    n_push_steps: int = eqx.field(static=True)
    diffraction: Diffraction = ExactOneWay()
    source_plane: float | None = eqx.field(static=True, default=None)
    shortcoming: str = eqx.field(static=True, default="")
    outer_layer: OuterLayer | None = None

    @property
    def liver(self) -> tuple[float, float]:
        """Axial positions of the front and the back of the liver [m], the outer layer left out."""
        n = 0 if self.outer_layer is None else self.outer_layer.n_elements
        return float(self.mesh.z_edges[n]), float(self.mesh.z_edges[-1 - n])

    def push_steps(self, duration: float, modulation: Modulation | None = None) -> PushSettings:
        """Time steps of a push of that length [s], with which the run ends: no longer than those of 0.5 ms."""
        n_steps = max(math.ceil(self.n_push_steps * duration / 0.5e-3 - 1e-9), self.n_push_steps)
        return PushSettings(duration / n_steps, n_steps, duration, modulation=modulation)

    def sound_field(
        self,
        model: Model,
        layers: Sequence[AcousticLayer],
        *,
        r: Float[np.ndarray, " r"],
        z: Float[np.ndarray, " z"],
        variation: MediumVariation | None = None,
    ) -> HarmonicField:
        """Sound field of the model's transducer in `layers`, at radii r and depths z [m]."""
        return solve_field(
            self.source(model),
            model.drive,
            layers,
            r=r,
            z=z,
            diffraction=self.diffraction,
            settings=self.march,
            variation=variation,
        )

    def source(self, model: Model) -> FocusedBowl | Source:
        """The model's transducer, as it radiates here."""
        return model.bowl if self.source_plane is None else ProjectedBowl(model.bowl, self.source_plane)

    def thermal_field(self, model: Model, temperature: Temperature, dose: Temperature = 0.0) -> ThermalField:
        """Thermal constants of every cell at its temperature [degC] and dose [min], or at one for all."""
        media = [layer.tissue.thermal(*values) for layer, *values in self._by_layer(model, temperature, dose)]
        return ThermalField(
            conductivity=self._on_grid([medium.conductivity for medium in media]),
            heat_capacity=self._on_grid([medium.heat_capacity for medium in media]),
            perfusion_conductance=self._on_grid([medium.perfusion_conductance for medium in media]),
            metabolic_heat=self._on_grid([medium.metabolic_heat for medium in media]),
        )

    def acoustic_variation(
        self, model: Model, temperature: Temperature, dose: Temperature, *, reference: float
    ) -> MediumVariation:
        """By how much attenuation and sound speed of every cell depart from those of fresh tissue at `reference`.

        Both are held at the ends of their laws' ranges. Density and the exponent of attenuation stay those of
        `reference`, and so does the share of attenuation that is absorption: their laws do not feed back on the field.

        Args:
            model: The model.
            temperature: Of every cell [degC].
            dose: Of every cell [equivalent min at 43 degC].
            reference: Temperature at which the layers themselves are taken [degC].
        """
        attenuation, sound_speed = [], []
        for layer, *values in self._by_layer(model, temperature, dose):
            for law, changes in ((layer.tissue.attenuation, attenuation), (layer.tissue.sound_speed, sound_speed)):
                changes.append(law.held(*values) - law.after(reference, 0.0))
        return MediumVariation(
            r=self.heat_grid.r,
            z=self.heat_grid.z,
            attenuation=self._on_grid(attenuation),
            sound_speed=self._on_grid(sound_speed),
        )

    def _by_layer(
        self, model: Model, temperature: Temperature, dose: Temperature
    ) -> list[tuple[Layer, Float[Array, "r part"], Float[Array, "r part"]]]:
        """Each layer that has cells, with their temperature and dose."""
        shape = self.heat_grid.shape
        temperature, dose = (jnp.broadcast_to(jnp.asarray(values, float), shape) for values in (temperature, dose))
        owner = np.asarray(self.layer_of_cell)
        parts = [(layer, np.flatnonzero(owner == index)) for index, layer in enumerate(model.layers)]
        return [
            (layer, temperature[:, columns[0] : columns[-1] + 1], dose[:, columns[0] : columns[-1] + 1])
            for layer, columns in parts
            if columns.size
        ]

    def _on_grid(self, parts: list) -> Float[Array, "r z"]:
        return jnp.concatenate([jnp.asarray(part, dtype=float) for part in parts], axis=1)


def discretise(model: Model, *, refinement: float = 1.0) -> Discretisation:
    """Grids, mesh and steps for the model's geometry, all spacings divided by `refinement`.

    Raises:
        InputError: if the geometric focus does not lie inside the liver, or the refinement is not positive.

    Accuracy: heat has walls that stay as warm as at the start: 20 mm from the focus, or nearer where the liver ends or
        the bowl begins. Beside walls 20 mm away, liver without blood flow, heated throughout, is too cold after
        minutes: the focus by 1.1 percent of its rise after 1800 s and 2.4 after 3600; 10 mm from it, by 3 percent after
        600 s and 20 after 1800. Nearer walls cool the focus sooner.
    """
    if not 0.0 < refinement < np.inf:
        raise InputError(f"`refinement` divides all spacings and must be positive and finite, got {refinement}.")
    focus = float(model.bowl.focal_length)
    front, back = model.liver_depth, model.liver_depth + model.liver_thickness
    if not front < focus < back:
        raise InputError(
            f"the geometric focus at {1e3 * focus:g} mm lies outside the liver, which reaches from {1e3 * front:g} to "
            f"{1e3 * back:g} mm: change the layers' thicknesses or the focal length."
        )
    beam = _relative_beam(model)
    heat_grid = _heat_grid(model, focus, refinement, beam)
    interfaces = np.cumsum([layer.thickness for layer in model.path])
    widest = 3e-3 / refinement
    r_edges = graded_positions(0.0, LIVER_RADIUS, 0.0, finest=0.15e-3 * beam / refinement, growth=1.25, coarsest=widest)
    z_edges = graded_positions(front, back, focus, finest=0.5e-3 * beam / refinement, growth=1.2, coarsest=widest)
    if model.outer_layer is not None:
        beyond = model.outer_layer.distances
        r_edges = np.concatenate([r_edges, LIVER_RADIUS + beyond])
        z_edges = np.concatenate([front - beyond[::-1], z_edges, back + beyond])
    return Discretisation(
        focus=focus,
        heat_grid=heat_grid,
        layer_of_cell=tuple(int(i) for i in np.searchsorted(interfaces, heat_grid.z)),
        mesh=Mesh(r_edges, z_edges, model.walls),
        march=march_settings(model, refinement),
        n_heat_steps=max(round(120 * refinement), 1),
        n_push_steps=max(round(25 * refinement), 1),
        outer_layer=model.outer_layer,
    )


def layers_at(model: Model, temperature: Temperature, path_temperature: Temperature) -> list[AcousticLayer]:
    """The model's layers for the sound field, liver at one temperature and the path at another [degC]."""
    path = [AcousticLayer(layer.tissue.acoustic(path_temperature), layer.thickness) for layer in model.path]
    return [*path, AcousticLayer(model.liver.acoustic(temperature), model.liver_thickness)]


def march_settings(model: Model, refinement: float = 1.0) -> MarchSettings:
    """Settings of the sound field's march: the defaults, scaled to the bowl's size and the wavelength.

    The defaults are for 32 mm and 1.1 MHz. The domain grows with the bowl, and the number of terms and of quadrature
    points with the number of wavelengths across it, so that accuracy stays what it is there at higher frequencies and
    for larger bowls.

    Accuracy: below 1.1 MHz the domain stays 62 mm wide, although the beam grows. On the axis, against O'Neil, largest
        error over the peak: 1.6e-3 at 0.5 MHz, 0.5 percent at 0.25, 1.5 at 0.2, 2.2 at 0.15, 5.5 at 0.1, 29 at 0.05.
    """
    default = MarchSettings()
    aperture, frequency = float(model.bowl.aperture_radius), float(model.drive.frequency)
    width = max(aperture / 32e-3, 1.0)
    wavelengths = relative_wavelengths(aperture, frequency)
    return MarchSettings(
        n_radial=math.ceil(refinement * default.n_radial * wavelengths),
        domain_radius=default.domain_radius * width,
        axial_step=default.axial_step / max(frequency / 1.1e6, 1.0) / refinement,
        start_plane=float(model.bowl.rim_depth) + RIM_TO_START,
        n_quadrature=math.ceil(default.n_quadrature * wavelengths),
    )


def _relative_beam(model: Model) -> float:
    """Width of the focus, wavelength times focal length over aperture, over that of the paper's bowl; at most 1."""
    width = model.bowl.focal_length / (model.drive.frequency * model.bowl.aperture_radius)
    return min(float(width) / (62.6e-3 / (1.1e6 * 32e-3)), 1.0)


def relative_wavelengths(aperture_radius: float, frequency: float) -> float:
    """Wavelengths across a bowl over those across 64 mm at 1.1 MHz, for which the march's defaults are; at least 1."""
    return max(aperture_radius / 32e-3, 1.0) * max(frequency / 1.1e6, 1.0)


def _heat_grid(model: Model, focus: float, refinement: float, beam: float) -> AxisymmetricGrid:
    start = max(focus - HEAT_REACH, float(model.bowl.rim_depth) + RIM_TO_HEAT)
    stop = min(focus + HEAT_REACH, model.liver_depth + model.liver_thickness)
    widest = 1.5e-3 / refinement
    z_faces = graded_positions(start, stop, focus, finest=0.4e-3 * beam / refinement, growth=1.1, coarsest=widest)
    depths = np.cumsum([layer.thickness for layer in model.path])
    inside = [depth for depth in depths if start + _SAME_FACE < depth < stop - _SAME_FACE]
    r_faces = graded_positions(0.0, HEAT_REACH, 0.0, finest=0.1e-3 * beam / refinement, growth=1.1, coarsest=widest)
    return AxisymmetricGrid(r_faces, _with_faces(z_faces, inside))


def _with_faces(z_faces: Float[np.ndarray, " n"], interfaces: list[float]) -> Float[np.ndarray, " m"]:
    """The faces with one at every interface, because conductivity may jump only at faces.

    The nearest face moves there, unless it is a wall or stands at another interface already: then one is added.
    """
    faces, taken = [float(face) for face in z_faces], {float(z_faces[0]), float(z_faces[-1])}
    for interface in map(float, interfaces):
        nearest = min(faces, key=lambda face: abs(face - interface))
        if nearest not in taken:
            faces.remove(nearest)
        faces = sorted({*faces, interface})
        taken.add(interface)
    return np.asarray(faces)
