"""The experiment file: a TOML file that says what was sonicated, with what and how.

Units stand in the names of the keys. Unknown keys are refused, and so are numbers whose size betrays another unit.
"""

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field, Strict, model_validator

from arfjax import tissues
from arfjax.errors import InputError
from arfjax.experiment.acoustics import AcousticsSection
from arfjax.experiment.drive import power_of_focal_pressure, power_of_source_pressure
from arfjax.experiment.mechanics import LesionSection, Mechanics
from arfjax.experiment.messages import EXAMPLE, explain
from arfjax.experiment.monitoring import MonitoringSection
from arfjax.experiment.numbers import Celsius, Millimetres, Number, Section, between
from arfjax.experiment.sonication import SonicationSection
from arfjax.mechanics.modulation import SineIntensity, SinePressure, Square
from arfjax.model import Layer, Model
from arfjax.protocols.discretisation import (
    HEAT_REACH,
    RIM_TO_HEAT,
    RIM_TO_START,
    Discretisation,
    relative_wavelengths,
)
from arfjax.protocols.stepwise import StepwiseProtocol
from arfjax.transducer import Drive, FocusedBowl

_FOCUS_MARGIN_MM = 1.0  # two of the finest elements
_DRIVES = ("acoustic_power_w", "source_pressure_kpa", "focal_pressure_mpa")
_MOST_RELATIVE_WAVELENGTHS = 16.0  # more need matrices of gigabytes


class Transducer(Section):
    """A spherical bowl with a central hole."""

    outer_diameter_mm: Millimetres
    inner_diameter_mm: Annotated[Number, between(0.0, 1000.0, "mm", "give millimetres")] = 0.0
    focal_length_mm: Millimetres
    frequency_mhz: Annotated[Number, between(0.05, 20.0, "MHz", "is it in Hz or kHz? Give MHz")]
    acoustic_power_w: Annotated[Number, between(1e-3, 1e4, "W", "give watts")] | None = None
    source_pressure_kpa: Annotated[Number, between(1e-2, 1e5, "kPa", "is it in pascal? Give kilopascal")] | None = None
    focal_pressure_mpa: Annotated[Number, between(1e-3, 200.0, "MPa", "is it in pascal? Give megapascal")] | None = None

    @model_validator(mode="after")
    def _driven_once(self) -> "Transducer":
        given = [name for name in _DRIVES if getattr(self, name) is not None]
        if len(given) != 1:
            names = " and ".join(given) or "none"
            raise ValueError(f"expected exactly one of {', '.join(_DRIVES)}, got {names}; how strongly is it driven?")
        return self

    @model_validator(mode="after")
    def _geometry_is_possible(self) -> "Transducer":
        if self.inner_diameter_mm >= self.outer_diameter_mm:
            raise ValueError(
                f"the hole (inner_diameter_mm {self.inner_diameter_mm:g}) must be smaller than the bowl "
                f"(outer_diameter_mm {self.outer_diameter_mm:g}); correct one of the two"
            )
        # A hole far smaller than the bowl is none, or is in metres.
        if 0.0 < self.inner_diameter_mm < 1e-2 * self.outer_diameter_mm:
            raise ValueError(
                f"inner_diameter_mm {self.inner_diameter_mm:g} is too small beside a bowl of "
                f"{self.outer_diameter_mm:g} mm; is it in metres? Give millimetres, or 0 for no hole"
            )
        if self.outer_diameter_mm >= 2.0 * self.focal_length_mm:
            raise ValueError(
                f"a bowl of outer_diameter_mm {self.outer_diameter_mm:g} cannot have a radius of curvature of only "
                f"focal_length_mm {self.focal_length_mm:g}: it would be more than a hemisphere; correct one of the two"
            )
        if self.focal_length_mm - self.rim_depth_mm < 1e3 * RIM_TO_HEAT + _FOCUS_MARGIN_MM:
            raise ValueError(
                f"the focus lies only {self.focal_length_mm - self.rim_depth_mm:.3g} mm beyond the bowl's rim, and "
                f"{1e3 * RIM_TO_HEAT + _FOCUS_MARGIN_MM:g} mm are needed; lengthen focal_length_mm or reduce "
                "outer_diameter_mm"
            )
        size = relative_wavelengths(0.5e-3 * self.outer_diameter_mm, 1e6 * self.frequency_mhz)
        if size > _MOST_RELATIVE_WAVELENGTHS:
            raise ValueError(
                f"a bowl of outer_diameter_mm {self.outer_diameter_mm:g} at frequency_mhz {self.frequency_mhz:g} is "
                f"{size:.0f} times as many wavelengths wide as the paper's; up to {_MOST_RELATIVE_WAVELENGTHS:g} times "
                "can be simulated, so reduce one of the two"
            )
        return self

    @property
    def rim_depth_mm(self) -> float:
        """Axial distance from the bowl's apex to the plane of its rim."""
        return self.focal_length_mm - math.sqrt(self.focal_length_mm**2 - 0.25 * self.outer_diameter_mm**2)


SONICATIONS_S, PUSHES_MS = (0.1, 180.0), (0.01, 20.0)
"""The shortest and the longest sonication and push of the stepwise protocol."""
PUSH_MODULATIONS = {"none": None, "intensity": SineIntensity(), "pressure": SinePressure(), "square": Square()}
"""Courses of the force over a push: one period, of full depth, or on for the half in the middle."""


class LayerSection(Section):
    """A planar layer: a named tissue, of which single constants may be replaced."""

    tissue: Literal["water", "skin", "fat", "muscle", "liver"]
    thickness_mm: Millimetres
    perfused: Annotated[bool, Strict()] = True
    coagulation_stops_perfusion: Annotated[bool, Strict()] = False
    coagulation_doubles_attenuation: Annotated[bool, Strict()] = False
    heat_constants: Literal["constant", "warming"] = "constant"

    @model_validator(mode="after")
    def _water_is_no_tissue(self) -> "LayerSection":
        if self.tissue != "water":
            return self
        for key in ("coagulation_stops_perfusion", "coagulation_doubles_attenuation", "heat_constants"):
            if getattr(self, key) not in (False, "constant"):
                raise ValueError(f"{key} is of tissue, and this layer is of water; leave it out")
        return self


class Protocol(Section):
    """The paper's stepwise protocol."""

    kind: Literal["stepwise"] = "stepwise"
    temperatures_c: list[Celsius] = Field(min_length=2)
    normalised_at_c: Celsius
    sonication_s: Annotated[Number, between(*SONICATIONS_S, "s", "is it in milliseconds? Give seconds")] = 60.0
    push_ms: Annotated[Number, between(*PUSHES_MS, "ms", "is it in seconds? Give milliseconds")] = 0.5
    push_modulation: Literal["none", "intensity", "pressure", "square"] = "none"

    @model_validator(mode="after")
    def _temperatures_rise(self) -> "Protocol":
        if any(later <= earlier for earlier, later in zip(self.temperatures_c, self.temperatures_c[1:], strict=False)):
            raise ValueError(f"temperatures_c must rise, got {self.temperatures_c}; sort them")
        low, high = self.temperatures_c[0], self.temperatures_c[-1]
        if not low <= self.normalised_at_c <= high:
            raise ValueError(
                f"normalised_at_c {self.normalised_at_c:g} must lie in the range of temperatures_c, {low:g} to {high:g}"
            )
        return self


class Experiment(Section):
    """An experiment file as read and checked; `calibration` and `inference` are left to whoever fits."""

    title: str = "untitled experiment"
    transducer: Transducer
    layers: list[LayerSection] = Field(min_length=1)
    mechanics: Mechanics = Mechanics()
    lesion: LesionSection = LesionSection()
    protocol: Protocol
    acoustics: AcousticsSection = AcousticsSection()
    sonication: SonicationSection = SonicationSection()
    monitoring: MonitoringSection = MonitoringSection()
    calibration: dict[str, Any] = {}
    inference: dict[str, Any] = {}

    @model_validator(mode="after")
    def _liver_is_last_and_holds_the_focus(self) -> "Experiment":
        names = [layer.tissue for layer in self.layers]
        if names[-1] != "liver" or names.count("liver") != 1 or len(names) < 2:
            raise ValueError(
                f"layers must end with the only layer of liver, after at least one other, got {', '.join(names)}"
            )
        front = sum(layer.thickness_mm for layer in self.layers[:-1])
        back = front + self.layers[-1].thickness_mm
        focus = self.transducer.focal_length_mm
        if not front + _FOCUS_MARGIN_MM <= focus <= back - _FOCUS_MARGIN_MM:
            raise ValueError(
                f"the focus at focal_length_mm {focus:g} must lie {_FOCUS_MARGIN_MM:g} mm or more inside the liver, "
                f"which the layers put at {front:g} to {back:g} mm from the bowl's apex; change a thickness_mm"
            )
        needed = self.transducer.rim_depth_mm + 1e3 * RIM_TO_START
        if self.layers[0].thickness_mm <= needed:
            raise ValueError(
                f"the first layer must hold the bowl: its thickness_mm counts from the bowl's apex and must exceed "
                f"{needed:.4g}, past the rim, got {self.layers[0].thickness_mm:g}"
            )
        return self

    @model_validator(mode="after")
    def _thermocouple_is_where_heat_is_followed(self) -> "Experiment":
        couple, focus, reach = self.sonication.thermocouple, self.transducer.focal_length_mm, 1e3 * HEAT_REACH
        back = sum(layer.thickness_mm for layer in self.layers)
        first = max(focus - reach, self.transducer.rim_depth_mm + 1e3 * RIM_TO_HEAT)
        last = min(focus + reach, back)
        middle, radius = focus + couple.axial_offset_mm, 0.5 * couple.junction_diameter_mm
        if not first <= middle - radius <= middle + radius <= last:
            raise ValueError(
                f"sonication.thermocouple reaches from {middle - radius:g} to {middle + radius:g} mm, and heat is "
                f"followed from {first:.4g} to {last:.4g} mm from the bowl's apex, within the layers; change its "
                "axial_offset_mm, or make the liver thicker"
            )
        return self

    def model(self) -> Model:
        """The model that the file describes; a pressure is taken for the power that makes it."""
        device, temperature = self.transducer, self.protocol.temperatures_c[0]
        if device.acoustic_power_w is not None:
            return self.model_at(device.acoustic_power_w)
        model = self.model_at(1.0)
        if device.source_pressure_kpa is not None:
            return self.model_at(power_of_source_pressure(model, 1e3 * device.source_pressure_kpa, temperature))
        assert device.focal_pressure_mpa is not None  # one of the three is given
        pressure = 1e6 * device.focal_pressure_mpa
        return self.model_at(power_of_focal_pressure(model, pressure, temperature, self.acoustics))

    def model_at(self, acoustic_power: float) -> Model:
        """The model at a power [W]."""
        device = self.transducer
        layers = [Layer(_tissue(section), 1e-3 * section.thickness_mm) for section in self.layers]
        return Model(
            bowl=FocusedBowl(
                aperture_radius=0.5e-3 * device.outer_diameter_mm,
                hole_radius=0.5e-3 * device.inner_diameter_mm,
                focal_length=1e-3 * device.focal_length_mm,
            ),
            drive=Drive(frequency=1e6 * device.frequency_mhz, acoustic_power=acoustic_power),
            path=tuple(layers[:-1]),
            liver=layers[-1].tissue,
            liver_thickness=layers[-1].thickness,
            lesion=self.lesion.lesion(),
            modulus_reading=self.mechanics.reading(),
            poisson_ratio=self.mechanics.poisson_ratio,
            walls=self.mechanics.held(),
            outer_layer=self.mechanics.outer_layer(),
        )

    def stepwise(self) -> StepwiseProtocol:
        """The protocol that the file describes."""
        return StepwiseProtocol(
            start_temperature=self.protocol.temperatures_c[0],
            final_temperature=self.protocol.temperatures_c[-1],
            duration=self.protocol.sonication_s,
            push_duration=1e-3 * self.protocol.push_ms,
            modulation=PUSH_MODULATIONS[self.protocol.push_modulation],
        )

    def discretised(self, model: Model, temperature: float | None = None) -> Discretisation:
        """Grids, mesh and steps for the model, its sound as the file's [acoustics] has it, linear if it does not say.

        Harmonics and steps of nonlinear sound are chosen with all tissue at `temperature` [degC], by default the
        protocol's first; not for `jit`.
        """
        temperature = self.protocol.temperatures_c[0] if temperature is None else temperature
        return self.acoustics.discretise(model, temperature)

    def sonicated(self) -> Model:
        """The model at the sonication's power."""
        power = self.sonication.acoustic_power_w
        return self.model() if power is None else self.model_at(power)


def read_experiment(path: str | Path) -> Experiment:
    """An experiment file, checked.

    Raises:
        InputError: in one line, if the file cannot be read, is not TOML, holds an unknown key, lacks one, or
            describes something impossible.
    """
    path = Path(path)
    try:
        return Experiment.model_validate(_read_toml(path))
    except pydantic.ValidationError as error:
        raise InputError(f"{path}: {explain(error, Experiment)}") from None


def _read_toml(path: Path) -> dict[str, Any]:
    expected = f"expected an experiment in TOML, such as {EXAMPLE}."
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; {expected}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a folder; {expected}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is not UTF-8 text (byte {error.start}); {expected}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {expected}") from None
    if not text.strip():
        raise InputError(f"{path}: the file is empty; {expected}")
    try:
        return tomllib.loads(text)
    # A number of thousands of digits is a ValueError, brackets nested as deep a RecursionError.
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid TOML: {str(error).rstrip('.')}; {expected}") from None


def _tissue(section: LayerSection) -> tissues.Tissue:
    tissue = tissues.BY_NAME[section.tissue]()
    if section.heat_constants == "warming":
        tissue = tissues.warming(tissue)
    if section.coagulation_doubles_attenuation:
        tissue = tissues.attenuating(tissue)
    if section.coagulation_stops_perfusion:
        tissue = tissues.coagulating(tissue)
    return tissue if section.perfused else tissues.unperfused(tissue)
