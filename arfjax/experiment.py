"""The experiment file: a TOML file that says what was sonicated, with what and how.

Units stand in the names of the keys. Unknown keys are refused, and so are numbers whose size betrays another unit.
"""

import difflib
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from arfjax import tissues
from arfjax.errors import InputError
from arfjax.mechanics.viscoelastic import ShearModulus, YoungModulus
from arfjax.model import DoseSize, Layer, Lesion, Model, tabulated_size
from arfjax.protocols.stepwise import StepwiseProtocol
from arfjax.transducer import Drive, FocusedBowl


def _between(low: float, high: float, unit: str) -> AfterValidator:
    """A check by magnitude, with bounds far outside what a focused-ultrasound experiment can have."""

    def check(value: float) -> float:
        if not low <= value <= high:
            raise ValueError(f"{value:g} is not between {low:g} and {high:g} {unit}; is it in another unit?")
        return value

    return AfterValidator(check)


Millimetres = Annotated[float, _between(0.2, 1000.0, "mm")]
Celsius = Annotated[float, _between(0.0, 120.0, "degC")]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Transducer(_Section):
    """A spherical bowl with a central hole."""

    outer_diameter_mm: Millimetres
    inner_diameter_mm: Annotated[float, _between(0.0, 1000.0, "mm")] = 0.0
    focal_length_mm: Millimetres
    frequency_mhz: Annotated[float, _between(0.05, 20.0, "MHz")]
    acoustic_power_w: Annotated[float, _between(1e-3, 1e4, "W")]

    @model_validator(mode="after")
    def _geometry_is_possible(self) -> "Transducer":
        if self.inner_diameter_mm >= self.outer_diameter_mm:
            raise ValueError(
                f"the hole ({self.inner_diameter_mm:g} mm) must be smaller than the bowl "
                f"({self.outer_diameter_mm:g} mm)"
            )
        if self.outer_diameter_mm >= 2.0 * self.focal_length_mm:
            raise ValueError(
                f"a bowl {self.outer_diameter_mm:g} mm wide cannot have a radius of curvature of only "
                f"{self.focal_length_mm:g} mm: it would be more than a hemisphere"
            )
        return self


class LayerSection(_Section):
    """A planar layer: a named tissue, of which single constants may be replaced."""

    tissue: Literal["water", "skin", "fat", "muscle", "liver"]
    thickness_mm: Millimetres
    perfused: bool = True


class Mechanics(_Section):
    """How the moduli are to be read."""

    modulus: Literal["young", "shear"] = "young"
    poisson_ratio: Annotated[float, _between(0.0, 0.49999, "")] = 0.499


class LesionSection(_Section):
    """Where the lesion's size comes from."""

    size: Literal["dose", "table"] = "dose"


class Protocol(_Section):
    """The paper's stepwise protocol."""

    kind: Literal["stepwise"] = "stepwise"
    temperatures_c: list[Celsius] = Field(min_length=2)
    normalised_at_c: Celsius
    sonication_s: Annotated[float, _between(0.1, 3600.0, "s")] = 60.0
    push_ms: Annotated[float, _between(0.01, 20.0, "ms")] = 0.5

    @model_validator(mode="after")
    def _temperatures_rise(self) -> "Protocol":
        if any(later <= earlier for earlier, later in zip(self.temperatures_c, self.temperatures_c[1:], strict=False)):
            raise ValueError(f"temperatures_c must rise, got {self.temperatures_c}")
        low, high = self.temperatures_c[0], self.temperatures_c[-1]
        if not low <= self.normalised_at_c <= high:
            raise ValueError(f"normalised_at_c {self.normalised_at_c:g} must lie in the range {low:g} to {high:g} degC")
        return self


class Experiment(_Section):
    """An experiment file as read and checked; `calibration` is left to whoever fits."""

    title: str = "untitled experiment"
    transducer: Transducer
    layers: list[LayerSection] = Field(min_length=1)
    mechanics: Mechanics = Mechanics()
    lesion: LesionSection = LesionSection()
    protocol: Protocol
    calibration: dict[str, Any] = {}

    @model_validator(mode="after")
    def _liver_is_last_and_holds_the_focus(self) -> "Experiment":
        names = [layer.tissue for layer in self.layers]
        if names[-1] != "liver" or names.count("liver") != 1 or len(names) < 2:
            raise ValueError(f"layers must end with the only layer of liver, after at least one other, got {names}")
        front = sum(layer.thickness_mm for layer in self.layers[:-1])
        back = front + self.layers[-1].thickness_mm
        if not front < self.transducer.focal_length_mm < back:
            raise ValueError(
                f"the focus at {self.transducer.focal_length_mm:g} mm lies outside the liver, which the layers put at "
                f"{front:g} to {back:g} mm"
            )
        return self

    def model(self) -> Model:
        """The model that the file describes."""
        device = self.transducer
        layers = [Layer(_tissue(section), 1e-3 * section.thickness_mm) for section in self.layers]
        return Model(
            bowl=FocusedBowl(
                aperture_radius=0.5e-3 * device.outer_diameter_mm,
                hole_radius=0.5e-3 * device.inner_diameter_mm,
                focal_length=1e-3 * device.focal_length_mm,
            ),
            drive=Drive(frequency=1e6 * device.frequency_mhz, acoustic_power=device.acoustic_power_w),
            path=tuple(layers[:-1]),
            liver=layers[-1].tissue,
            liver_thickness=layers[-1].thickness,
            lesion=Lesion(
                tissues.lesion_viscoelasticity(), tabulated_size() if self.lesion.size == "table" else DoseSize()
            ),
            modulus_reading=YoungModulus() if self.mechanics.modulus == "young" else ShearModulus(),
            poisson_ratio=self.mechanics.poisson_ratio,
        )

    def stepwise(self) -> StepwiseProtocol:
        """The protocol that the file describes."""
        return StepwiseProtocol(
            start_temperature=self.protocol.temperatures_c[0],
            final_temperature=self.protocol.temperatures_c[-1],
            duration=self.protocol.sonication_s,
            push_duration=1e-3 * self.protocol.push_ms,
        )


def read_experiment(path: str | Path) -> Experiment:
    """An experiment file, checked.

    Raises:
        InputError: in one line, if the file cannot be read, is not TOML, holds an unknown key, lacks one, or
            describes something impossible.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected an experiment in TOML.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as UTF-8 text ({error}); expected an experiment in TOML.") from None
    try:
        return Experiment.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}.") from None
    except pydantic.ValidationError as error:
        raise InputError(f"{path}: {explain(error, Experiment)}") from None


def explain(error: pydantic.ValidationError, schema: type[BaseModel]) -> str:
    """The first thing that a validation found wrong, in one line, with the nearest known key for an unknown one."""
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"]) or "the file as a whole"
    if first["type"] == "extra_forbidden":
        unknown = str(first["loc"][-1])
        near = difflib.get_close_matches(unknown, _known_keys(schema), n=1)
        advice = f"did you mean `{near[0]}`?" if near else "remove it."
        return f"unknown key `{where}`; {advice}"
    if first["type"] == "missing":
        return f"missing key `{where}`; add it (examples/suomi2016.toml shows all)."
    return f"`{where}`: {first['msg'].removeprefix('Value error, ')}."


def _known_keys(schema: type[BaseModel]) -> list[str]:
    keys = []
    for name, field in schema.model_fields.items():
        keys.append(name)
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                keys.extend(_known_keys(candidate))
    return keys


def _tissue(section: LayerSection) -> tissues.Tissue:
    tissue = tissues.BY_NAME[section.tissue]()
    return tissue if section.perfused else tissues.unperfused(tissue)
