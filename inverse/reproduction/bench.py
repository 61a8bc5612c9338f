"""The paper's experiment set up once: fields, heating, lesions and pushes that many rows share, each compiled once."""

import dataclasses
import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from arfjax import (
    ConstrainedModulus,
    DamageEdge,
    Discretisation,
    DoseSize,
    Experiment,
    Heating,
    LinearEdge,
    Model,
    SharpEdge,
    ShearModulus,
    StepwiseProtocol,
    StepwiseResult,
    ViscoelasticField,
    YoungModulus,
    focal_response,
    focused_mesh,
    suomi2016,
    tabulated_size,
)
from arfjax.laws import Constant, Scaled
from arfjax.mechanics.transient.push import solve_push
from arfjax.numerics.compiled import compiled
from arfjax.protocols.discretisation import LIVER_RADIUS
from arfjax.protocols.heated_tissue import push_material
from arfjax.protocols.homogeneous import homogeneous_material
from arfjax.protocols.stepwise import heating_by, lesion_at, lesion_share
from arfjax.thermal.lesion import LesionSize
from inverse.reproduction.sound import HARMONICS, Maps, field_maps, varied_force

TEMPERATURES = (35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0)
"""Of the paper's protocol [degC]."""

SHARP_WIDTH = 0.2e-3  # m; two elements of the mesh here

LESIONS = ("table", "semi-axes", "dose")
MODULI = {"Young": YoungModulus(), "shear": ShearModulus(), "constrained": ConstrainedModulus()}
LIVERS = ("1.1 kPa", "1.1 Pa")

_NO_LESION = 1e-9


class Case(NamedTuple):
    """One reading of what the paper leaves open about the solid.

    Attributes:
        lesion: "table" (lengths and diameters), "semi-axes" (the same numbers, twice as large a lesion) or "dose".
        edge: "linear" (from centre to surface), "sharp", or "dose": the dose's own shape, without an ellipsoid.
        modulus: What table 2 and 3 hold, a key of `MODULI`.
        liver: Liver's M_0, as meant ("1.1 kPa") or as printed ("1.1 Pa").
    """

    lesion: str = "table"
    edge: str = "linear"
    modulus: str = "Young"
    liver: str = "1.1 kPa"


@dataclasses.dataclass(frozen=True)
class Bench:
    """Model, protocol and discretisation, and what is computed with them.

    The mesh is finer than `discretise` makes it, because the paper's lesion of 60 degC is 0.6 mm wide: elements of 0.1
    x 0.3 mm about the focus are within 0.3 percent points of ones half as large, where the default's are within 1.5.

    Attributes:
        model: The experiment's, its lesion apart.
        protocol: The experiment's.
        settings: Discretisation with linear sound.
        coarse: The same with the mesh of `discretise`, for liver without a lesion and for steady motion.
    """

    model: Model
    protocol: StepwiseProtocol
    settings: Discretisation
    coarse: Discretisation

    @classmethod
    def of(cls, described: Experiment) -> "Bench":
        """The bench of an experiment file."""
        model = described.model()
        coarse = described.discretised(model)
        coarse = dataclasses.replace(coarse, march=dataclasses.replace(coarse.march, n_harmonics=1))
        front, back = coarse.liver
        mesh = focused_mesh(
            focus=coarse.focus,
            radius=LIVER_RADIUS,
            front=front,
            back=back,
            finest_r=0.1e-3,
            finest_z=0.3e-3,
            fine_radius=1e-3,
            fine_length=8e-3,
            coarsest=3e-3,
            walls=model.walls,
        )
        settings = dataclasses.replace(coarse, mesh=mesh, outer_layer=None)
        return cls(model, described.stepwise(), settings, coarse)

    def linear(self, temperature: float) -> Maps:
        """Linear field of the model's power, the liver at `temperature` [degC]."""
        return self._linear(temperature, float(self.model.drive.acoustic_power))

    def nonlinear(self, temperature: float, power: float) -> Maps:
        """Field with `HARMONICS` harmonics at a power [W], the liver at `temperature` [degC]."""
        return self._nonlinear(temperature, power)

    def varied_force(
        self, temperature: float, attenuation: Float[np.ndarray, "r z"], sound_speed: Float[np.ndarray, "r z"]
    ) -> Float[Array, "rq zq"]:
        """Force [N/m^3] of the linear field of the model's power where constants vary; see `varied_force`."""
        return self._varied(temperature, jnp.asarray(attenuation), jnp.asarray(sound_speed))

    @functools.cached_property
    def _linear(self) -> Callable[[float, float], Maps]:
        return field_maps(self.model, self.protocol, self.settings)

    @functools.cached_property
    def _nonlinear(self) -> Callable[[float, float], Maps]:
        return field_maps(self.model, self.protocol, self.settings, harmonics=HARMONICS)

    @functools.cached_property
    def _varied(self) -> Callable[[float, Array, Array], Array]:
        return varied_force(self.model, self.protocol, self.settings)

    @functools.cached_property
    def heating(self) -> Heating:
        """The sonication by the linear field."""
        return self._heating(self.linear(self.protocol.start_temperature).heat)

    @functools.cached_property
    def heating_nonlinear(self) -> Heating:
        """The sonication by the nonlinear field of the power that heats so if sound is linear.

        Its `acoustic_power` is still the model's scaled by what this field would need more or less than the linear one.
        """
        power = float(self.heating.acoustic_power)
        heat = self.nonlinear(self.protocol.start_temperature, power).heat
        return self._heating(heat * (float(self.model.drive.acoustic_power) / power))

    @functools.cached_property
    def _heating(self) -> Callable[[Array], Heating]:
        return jax.jit(lambda heat: heating_by(self.model, heat, self.protocol, self.settings))

    def size(self, lesion: str, temperature: float, *, heating: Heating | None = None) -> LesionSize:
        """The lesion when the focus reaches `temperature` [degC], by one of `LESIONS`."""
        model = self._with_lesion(Case(lesion))
        return lesion_at(model, self.heating if heating is None else heating, temperature, self.settings)

    def share(self, case: Case, temperature: float, *, heating: Heating | None = None) -> Float[Array, "rq zq"]:
        """Share of the lesion at the Gauss points."""
        heating = self.heating if heating is None else heating
        size = self.size(case.lesion, temperature, heating=heating)
        return lesion_share(self._with_lesion(case), heating, temperature, size, self.settings, self.settings.mesh)

    def _with_lesion(self, case: Case) -> Model:
        size = DoseSize() if case.lesion == "dose" else tabulated_size(semi_axes=case.lesion == "semi-axes")
        edge = {"linear": LinearEdge(), "sharp": SharpEdge(SHARP_WIDTH), "dose": DamageEdge()}[case.edge]
        return dataclasses.replace(self.model, lesion=dataclasses.replace(self.model.lesion, size=size, edge=edge))

    def material(
        self, case: Case, temperature: float, share: Float[Array, "rq zq"], *, lesion_stiffness: float = 1.0
    ) -> ViscoelasticField:
        """Liver at `temperature` [degC] of which a share is lesion.

        Args:
            case: Whose modulus and liver's M_0 count here.
            temperature: [degC].
            share: Of the lesion at the Gauss points.
            lesion_stiffness: What the lesion's M_inf - M_0 is multiplied by.
        """
        return self._material(case.modulus, case.liver, jnp.asarray(temperature), share, jnp.asarray(lesion_stiffness))

    @functools.cached_property
    def _material(self) -> Callable[..., ViscoelasticField]:
        @compiled
        def material(modulus: str, liver: str, temperature: Array, share: Array, stiffness: Array):
            law = self.model.lesion.viscoelasticity
            usual = law.branch_modulus
            stiffer = Scaled(usual, stiffness, unit=usual.unit, source=usual.source, valid_range=usual.valid_range)
            model = dataclasses.replace(
                self.model if liver == LIVERS[0] else as_printed(self.model),
                modulus_reading=MODULI[modulus],
                lesion=dataclasses.replace(
                    self.model.lesion, viscoelasticity=dataclasses.replace(law, branch_modulus=stiffer)
                ),
            )
            return push_material(model, temperature, share)

        return material

    def response(self, case: Case, temperature: float, *, lesion_stiffness: float = 1.0) -> Float[Array, "rq zq"]:
        """Focal displacement per force density at each Gauss point [m/(N/m^3)]; see `focal_response`."""
        share = self.share(case, temperature)
        if float(jnp.max(share)) < _NO_LESION:
            return self._without_lesion(case.modulus, case.liver)
        return self._response(self.material(case, temperature, share, lesion_stiffness=lesion_stiffness))

    @functools.cached_property
    def _response(self) -> Callable[[ViscoelasticField], Array]:
        return jax.jit(lambda material: focal_response(material, self.protocol, self.settings))

    def _without_lesion(self, modulus: str, liver: str) -> Float[Array, "rq zq"]:
        if (modulus, liver) not in self._plain:
            none = jnp.zeros((len(self.settings.mesh.gauss_r), len(self.settings.mesh.gauss_z)))
            case = Case(modulus=modulus, liver=liver)
            self._plain[modulus, liver] = self._response(self.material(case, self.protocol.start_temperature, none))
        return self._plain[modulus, liver]

    @functools.cached_property
    def _plain(self) -> dict[tuple[str, str], Array]:
        return {}

    def homogeneous_response(
        self, branch_modulus: float, relaxed_modulus: float, relaxation_time: float
    ) -> Float[Array, "rq zq"]:
        """As `response`, of liver that is one Zener solid [Pa, Pa, s] with Young's moduli."""
        return self._response(
            homogeneous_material(
                dataclasses.replace(self.model, modulus_reading=YoungModulus()),
                branch_modulus,
                self.settings,
                temperature=self.protocol.start_temperature,
                relaxed_modulus=relaxed_modulus,
                relaxation_time=relaxation_time,
            )
        )

    def run(self, lesion: str) -> StepwiseResult:
        """The stepwise protocol with the linear field, lesion by "table" or "dose", all else as by default."""
        case, heating = Case(lesion), self.heating
        histories, sizes = [], [self.size(lesion, temperature) for temperature in TEMPERATURES]
        for temperature in TEMPERATURES:
            material = self.material(case, temperature, self.share(case, temperature))
            histories.append(self._push(material, self.linear(temperature).force))
        return StepwiseResult(
            temperature=jnp.asarray(TEMPERATURES),
            time=jnp.interp(jnp.asarray(TEMPERATURES), heating.focal_temperature, heating.time),
            displacement_history=jnp.stack(histories),
            lesion_length=jnp.stack([size.length for size in sizes]),
            lesion_diameter=jnp.stack([size.diameter for size in sizes]),
        )

    @functools.cached_property
    def _push(self) -> Callable[[ViscoelasticField, Array], Array]:
        steps, settings = self.protocol.push_steps(self.settings), self.settings
        return jax.jit(
            lambda material, force: solve_push(settings.mesh, material, force, settings=steps).at_focus(settings.focus)
        )


def as_printed(model: Model) -> Model:
    """The model with liver's M_0 in the unit that table 3 prints: 1.1 Pa."""
    law = model.liver.viscoelasticity
    assert law is not None  # `Model` checks it
    printed = Constant(
        suomi2016.TABLE_3_LIVER_RELAXED_MODULUS_AS_PRINTED_PA,
        unit="Pa",
        source=f"{suomi2016.PAPER}, table 3, as printed",
    )
    changed = dataclasses.replace(law, relaxed_modulus=printed)
    return dataclasses.replace(model, liver=dataclasses.replace(model.liver, viscoelasticity=changed))
