"""What an experiment file says of an inference: which constants are free, what was believed of them, and the noise.

    [inference]
    reference_temperature_c = 37.0
    attenuation_anchors_c = [35.0, 45.0, 55.0, 65.0, 84.0]

    [[inference.parameters]]
    name = "lesion_stiffness"
    place = "model.lesion.viscoelasticity.branch_modulus.value"
    unit = "Pa"
    prior = { kind = "log-normal", log_sd = 0.5, source = "assumed (ours)" }

Constants named in `across_sonications = ["lesion_stiffness"]` differ from sonication to sonication about the middle of
a population; `population_spread = 0.5` is the scale of the half-normal prior of its standard deviation (of the
logarithm, for positive constants). A log-normal prior without a median is about what the model holds. Places begin with
`model.`, or with `noise.hmi.` and `noise.dma.`. Where the file names no parameters, those of `DEFAULTS` are free.
"""

import re
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, Strict, ValidationError, model_validator

from arfjax import Experiment, InputError, Model, NormalisedPolynomial, PolynomialThrough, explain
from inverse.inference import places
from inverse.inference.noise import NoiseModel
from inverse.inference.parameter_set import ParameterSet, parameter
from inverse.inference.problem import Measurement, Problem, State
from inverse.inference.sonications import Sonications, across_sonications
from inverse.priors import ASSUMED, HalfNormal, LogNormal, LogUniform, Normal, Prior, Uniform

_SCALED = re.compile(r"\b(?:[kMGTmuµnc](?:Pa|Hz|W|m|s|J|N)|dB|Np/cm)\b")
"""Multiples of SI units, and what is no SI unit, that constants are often written in."""
_FAR = 30.0
"""Factor beyond the middle 95 percent of a prior at which its unit is taken for another one."""

_Number = Annotated[float, Strict(), AllowInfNan(False)]
_Celsius = Annotated[_Number, Field(ge=0.0, le=120.0)]

_NEEDED = {
    "normal": ("mean", "sd"),
    "log-normal": ("log_sd",),
    "uniform": ("lower", "upper"),
    "log-uniform": ("lower", "upper"),
    "half-normal": ("sd",),
}


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PriorSection(_Section):
    """A prior, as a file holds it."""

    kind: Literal["normal", "log-normal", "uniform", "log-uniform", "half-normal"]
    mean: _Number | None = None
    sd: _Number | None = None
    median: _Number | None = None
    log_sd: _Number | None = None
    lower: _Number | None = None
    upper: _Number | None = None
    source: str = ASSUMED

    @model_validator(mode="after")
    def _complete(self) -> "PriorSection":
        missing = [name for name in _NEEDED[self.kind] if getattr(self, name) is None]
        if missing:
            raise ValueError(f"a {self.kind} prior needs {' and '.join(_NEEDED[self.kind])}; {missing[0]} is missing")
        known = (*_NEEDED[self.kind], *(("median",) if self.kind == "log-normal" else ()))
        if other := sorted(self.model_fields_set - {"kind", "source", *known}):
            raise ValueError(f"a {self.kind} prior has no {other[0]}; it takes {' and '.join(known)}")
        return self

    def prior(self, standing: float) -> Prior:
        """The prior, about what stands in the model where the file gives no median."""
        given = {name: value for name in _NEEDED[self.kind] if (value := getattr(self, name)) is not None}
        if self.kind == "log-normal":
            return LogNormal(standing if self.median is None else self.median, given["log_sd"], source=self.source)
        kinds: dict[str, Callable[..., Prior]] = {
            "normal": Normal, "uniform": Uniform, "log-uniform": LogUniform, "half-normal": HalfNormal,
        }  # fmt: skip
        return kinds[self.kind](**given, source=self.source)


class ParameterSection(_Section):
    """A free constant, as a file holds it."""

    name: str = Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    place: str
    unit: str = "1"
    label: str = ""
    relative: bool = False
    prior: PriorSection


class InferenceSettings(_Section):
    """The section `[inference]` of an experiment file."""

    reference_temperature_c: _Celsius = 37.0
    attenuation_anchors_c: tuple[_Celsius, ...] = (35.0, 45.0, 55.0, 65.0, 84.0)
    parameters: tuple[ParameterSection, ...] = ()
    across_sonications: tuple[str, ...] = ()
    population_spread: Annotated[_Number, Field(gt=0.0)] = 0.5

    @model_validator(mode="after")
    def _sound(self) -> "InferenceSettings":
        anchors = self.attenuation_anchors_c
        if len(anchors) < 2 or any(b - a < 1.0 for a, b in zip(anchors, anchors[1:], strict=False)):
            raise ValueError(f"attenuation_anchors_c must be two or more that rise by 1 K or more, got {anchors}")
        return self


DIFFERING = ("lesion_stiffness",)
"""What differs where populations are asked for and nothing is named: each sonication makes a lesion of its own."""


def _default(name: str, place: str, unit: str, label: str, log_sd: float) -> ParameterSection:
    prior = PriorSection(kind="log-normal", log_sd=log_sd)
    return ParameterSection(name=name, place=place, unit=unit, label=label, prior=prior)


_LESION, _LIVER = "model.lesion.viscoelasticity", "model.liver.viscoelasticity"
DEFAULTS = (
    *(
        _default(f"attenuation_{k}", f"model.liver.attenuation.values[{k}]", "Np/m", f"attenuation at anchor {k}", 0.35)
        for k in range(5)
    ),
    _default("liver_stiffness", f"{_LIVER}.branch_modulus.value", "Pa", "liver stiffness", 0.25),
    _default("lesion_stiffness", f"{_LESION}.branch_modulus.value", "Pa", "lesion stiffness", 0.5),
    _default("lesion_stiffness_rate", f"{_LESION}.branch_modulus.rate", "1/K", "growth of lesion stiffness", 0.5),
    _default("lesion_relaxation_time", f"{_LESION}.relaxation_time.value", "s", "lesion relaxation time", 0.5),
)
"""What is free where a file does not say: attenuation at five temperatures (a quarter for its level and a quarter for
its shape make 0.35), stiffness of liver, and the lesion's stiffness, its rate and its relaxation time."""

NOISE = ParameterSection(
    name="noise",
    place="noise.hmi.relative",
    unit="1",
    label="relative deviation of HMI",
    prior=PriorSection(kind="log-uniform", lower=1e-3, upper=0.5),
)
"""Scatter of HMI data that come without deviations."""

DMA_NOISE = ParameterSection(
    name="dma_noise",
    place="noise.dma.additive",
    unit="1",
    label="deviation of the logarithm of DMA moduli",
    prior=PriorSection(kind="log-uniform", lower=1e-4, upper=1.0),
)
"""Scatter of DMA data that come without deviations."""


def inference_settings(described: Experiment, name: str) -> InferenceSettings:
    """The section `[inference]` of an experiment, checked.

    Raises:
        InputError: if it holds what it should not.
    """
    try:
        return InferenceSettings.model_validate(described.inference)
    except ValidationError as error:
        raise InputError(f"{name}: [inference] {explain(error, InferenceSettings)}") from None


_AT_ANCHORS = "model.liver.attenuation.values"


def anchored(model: Model, settings: InferenceSettings) -> Model:
    """The model with the liver's attenuation given by its values at the anchors, where it is a polynomial.

    Raises:
        InputError: if there are fewer anchors than the polynomial has coefficients, or values at them are free where
            the attenuation is no polynomial.
    """
    law = model.liver.attenuation
    if not isinstance(law, NormalisedPolynomial):
        free = [section.place for section in settings.parameters or DEFAULTS]
        if isinstance(law, PolynomialThrough) or not any(place.startswith(_AT_ANCHORS) for place in free):
            return model
        raise InputError(
            f"`{_AT_ANCHORS}` is free, but the liver's attenuation is no polynomial in temperature alone: set "
            "`coagulation_doubles_attenuation = false` under liver, or name other `inference.parameters`."
        )
    anchors = settings.attenuation_anchors_c
    if len(anchors) != len(law.coefficients):
        raise InputError(
            f"`inference.attenuation_anchors_c` has {len(anchors)} temperatures; the liver's attenuation is a "
            f"polynomial of {len(law.coefficients)} coefficients and needs as many."
        )
    values = jnp.asarray(law.evaluate(np.asarray(anchors)))
    through = PolynomialThrough(anchors, values, unit=law.unit, source=law.source, valid_range=law.valid_range)
    return eqx.tree_at(lambda tree: tree.liver.attenuation, model, through)


def free_parameters(settings: InferenceSettings, model: Model, noise: dict[str, NoiseModel]) -> ParameterSet:
    """The parameters that the settings free, with the noise's where the data come without deviations.

    Raises:
        InputError: if a place does not exist or does not hold one number.
    """
    state = State(model, noise)
    sections = list(settings.parameters or DEFAULTS)
    named = {section.place for section in sections}
    for measurement, section in (("hmi", NOISE), ("dma", DMA_NOISE)):
        unknown = measurement in noise and noise[measurement].known is None
        if unknown and section.place not in named:
            sections.append(section)
    return ParameterSet(tuple(_entry(section, state) for section in sections))


def _entry(section: ParameterSection, state: State) -> Any:
    if not section.place.startswith(("model.", "noise.")):
        raise InputError(
            f"`inference.parameters` {section.name}: a place begins with `model.` or `noise.`, got `{section.place}`."
        )
    if scaled := _SCALED.search(section.unit):
        raise InputError(
            f"`inference.parameters` {section.name}: the unit {section.unit} is a multiple ({scaled.group()}), and the "
            "model's numbers are in SI units: give unit and prior in those (Pa, m, s, Hz, Np/m)."
        )
    standing = places.read(state, section.place)
    if standing.ndim:
        raise InputError(
            f"`inference.parameters` {section.name}: `{section.place}` holds {standing.size} numbers; "
            "add an index in brackets."
        )
    about = 1.0 if section.relative else float(standing)
    try:
        prior = section.prior.prior(about)
    except InputError as error:
        raise InputError(f"`inference.parameters` {section.name}: {error}") from None
    _require_near(section, prior, about)
    place = places.counted_from_start(state, section.place)
    return parameter(section.name, place, section.unit, prior, label=section.label, relative=section.relative)


def _require_near(section: ParameterSection, prior: Prior, standing: float) -> None:
    """Refuse a prior of a positive constant that is orders of magnitude off what the model holds, as in other units."""
    low, high = (float(prior.quantile(probability)) for probability in (0.025, 0.975))
    of_model = section.place.startswith("model.") and standing > 0.0
    if of_model and high > 0.0 and not low / _FAR <= standing <= high * _FAR:
        raise InputError(
            f"`inference.parameters` {section.name}: the prior lies between {low:.3g} and {high:.3g}, and the model "
            f"holds {standing:.3g} {section.unit} at `{section.place}`; give the prior in SI units, or the model a "
            "value near it."
        )


def inference_problem(
    settings: InferenceSettings,
    model: Model,
    measurements: tuple[Measurement, ...],
    *,
    sonications: Sequence[str] = (),
) -> Problem:
    """The inference that a file asks for: a model, what is free in it, what was measured.

    Args:
        settings: From `inference_settings`.
        model: The model.
        measurements: Of it.
        sonications: What those of HMI data are called, between which constants may differ.

    Raises:
        InputError: if a place does not exist, or what is to differ between sonications cannot.
    """
    noise = {measurement.name: measurement.noise for measurement in measurements}
    parameters, root = population(settings, model, noise, sonications)
    return Problem(parameters, root, measurements)


def population(
    settings: InferenceSettings, model: Model, noise: dict[str, NoiseModel], sonications: Sequence[str]
) -> tuple[ParameterSet, Model | Sonications]:
    """The free parameters and the model that they stand in, for each sonication where constants are to differ.

    Raises:
        InputError: as `inference_problem`.
    """
    parameters = free_parameters(settings, model, noise)
    if not settings.across_sonications:
        return parameters, model
    return across_sonications(
        parameters,
        model,
        settings.across_sonications,
        sonications,
        spread=settings.population_spread,
        with_sweeps="dma" in noise,
    )
