"""Which constants of tissue vary, by how much, and who measured it.

Only the width is taken from the measurements: each constant is drawn as a factor of mean one on the model's own value,
because the model's values are those of another study. All factors are independent of each other, which measurements
do not say: a stiff liver may well attenuate more.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Literal

import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from arfjax import InputError, Model
from arfjax.laws import Scaled, ScaledRise, TemperatureLaw, ViscoelasticLaw
from arfjax.media import Scalar

FRESH_TEMPERATURE = 37.0  # degC; of the tissue whose values are stated, and above whose attenuation it rises
LESION_TEMPERATURE = 65.0  # degC; in the middle of the paper's table of the lesion


@dataclasses.dataclass(frozen=True)
class Spread:
    """A constant that varies.

    Attributes:
        name: What files call it.
        label: What figures and tables call it.
        unit: Of its value.
        relative_sd: Standard deviation over mean [1].
        distribution: Of the factor, whose mean is one.
        source: Where the standard deviation comes from.
        measured: Whether it is that of a measurement; otherwise an assumption, reasoned in `source`.
        place: The model with the constant multiplied by a factor.
        central: The model's own value [unit].
    """

    name: str
    label: str
    unit: str
    relative_sd: float
    distribution: Literal["normal", "log-normal"]
    source: str
    measured: bool
    place: Callable[[Model, Scalar], Model]
    central: Callable[[Model], float]

    def __post_init__(self) -> None:
        """Refuse a spread that is none, or so wide that a normal factor could be negative."""
        widest = 0.3 if self.distribution == "normal" else math.inf
        if not 0.0 <= self.relative_sd <= widest:
            raise InputError(
                f"spread of {self.name}: `relative_sd` must be 0 to {widest:g}, got {self.relative_sd:g}; "
                "it is a share of the mean, and wide ones are log-normal."
            )

    def factor(self, probability: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        """Factors below which these shares of the distribution lie."""
        normal = scipy.stats.norm.ppf(probability)
        if self.distribution == "normal":
            return 1.0 + self.relative_sd * normal
        variance = math.log1p(self.relative_sd**2)  # of the logarithm
        return np.exp(math.sqrt(variance) * normal - 0.5 * variance)


def draw_factors(spreads: Sequence[Spread], n_samples: int, seed: int) -> Float[np.ndarray, "sample constant"]:
    """Independent factors of every constant, by Latin hypercube sampling.

    Each of `n_samples` equally probable strata of each constant holds one draw, so that means and standard deviations
    of the draws are nearer to those of the distributions than independent draws would be.

    Raises:
        InputError: if there are fewer than two samples, or no spreads.
    """
    if n_samples < 2:
        raise InputError(f"`samples` must be 2 or more, because one has no spread; got {n_samples}.")
    if not spreads:
        raise InputError("no constant varies; give at least one spread.")
    rng = np.random.default_rng(seed)
    strata = np.tile(np.arange(n_samples), (len(spreads), 1))
    probability = (rng.permuted(strata, axis=1) + rng.random((len(spreads), n_samples))) / n_samples
    return np.stack([each.factor(row) for each, row in zip(spreads, probability, strict=True)], axis=1)


def varied(model: Model, spreads: Sequence[Spread], factors: Float[Array, " constant"]) -> Model:
    """The model with every constant multiplied by its factor."""
    for index, spread in enumerate(spreads):
        model = spread.place(model, factors[index])
    return model


def _scaled(law: TemperatureLaw, factor: Scalar) -> Scaled:
    return Scaled(law, factor, unit=law.unit, source=law.source, valid_range=law.valid_range)


def _on_liver(
    name: str, change: Callable[[TemperatureLaw, Scalar], TemperatureLaw]
) -> Callable[[Model, Scalar], Model]:
    """Changes one law of the liver."""

    def place(model: Model, factor: Scalar) -> Model:
        law = change(getattr(model.liver, name), factor)
        return dataclasses.replace(model, liver=dataclasses.replace(model.liver, **{name: law}))

    return place


def _of_fresh_liver(name: str) -> Callable[[Model], float]:
    return lambda model: float(jnp.asarray(getattr(model.liver, name).after(FRESH_TEMPERATURE, 0.0)))


def _stiffer(solid: ViscoelasticLaw, factor: Scalar) -> ViscoelasticLaw:
    return dataclasses.replace(
        solid,
        relaxed_modulus=_scaled(solid.relaxed_modulus, factor),
        branch_modulus=_scaled(solid.branch_modulus, factor),
    )


def _stiffer_liver(model: Model, factor: Scalar) -> Model:
    solid = model.liver.viscoelasticity
    assert solid is not None  # the last layer moves
    return dataclasses.replace(model, liver=dataclasses.replace(model.liver, viscoelasticity=_stiffer(solid, factor)))


def _stiffer_lesion(model: Model, factor: Scalar) -> Model:
    solid = _stiffer(model.lesion.viscoelasticity, factor)
    return dataclasses.replace(model, lesion=dataclasses.replace(model.lesion, viscoelasticity=solid))


def _risen(law: TemperatureLaw, factor: Scalar) -> ScaledRise:
    return ScaledRise(law, factor, FRESH_TEMPERATURE, unit=law.unit, source=law.source, valid_range=law.valid_range)


def _rise_of_attenuation(model: Model) -> float:
    law = model.liver.attenuation
    return float(jnp.asarray(law.evaluate(LESION_TEMPERATURE) - law.evaluate(FRESH_TEMPERATURE)))


def _liver_modulus(model: Model) -> float:
    solid = model.liver.viscoelasticity
    assert solid is not None  # the last layer moves
    return float(jnp.asarray(solid(FRESH_TEMPERATURE).unrelaxed_modulus))


SPREADS = (
    Spread(
        name="liver_attenuation",
        label="attenuation of liver, at all temperatures",
        unit="Np/m",
        relative_sd=0.03 / 0.52,
        distribution="normal",
        source="0.52 +- 0.03 dB/(cm MHz) between 39 healthy humans at 3 MHz, Ultrason. Imaging 6 (1984) 117, abstract "
        "(bovine liver: 0.05 +- 0.01 Np/(cm MHz), Parker, Ultrasound Med. Biol. 9 (1983) 363, abstract)",
        measured=True,
        place=_on_liver("attenuation", _scaled),
        central=_of_fresh_liver("attenuation"),
    ),
    Spread(
        name="liver_attenuation_rise",
        label="rise of attenuation in heated liver",
        unit="Np/m",
        relative_sd=0.5 / 2.67,
        distribution="log-normal",
        source="2.67 +- 0.5 dB/cm at 3.5 MHz, asymptote of coagulating porcine liver, Clarke et al., Ultrasound Med. "
        "Biol. 29 (2003) 127, abstract; an error of a fit, taken for the spread between livers",
        measured=True,
        place=_on_liver("attenuation", _risen),
        central=_rise_of_attenuation,
    ),
    Spread(
        name="liver_sound_speed",
        label="sound speed of liver",
        unit="m/s",
        relative_sd=11.0 / 1577.0,
        distribution="normal",
        source="1577 +- 11 m/s, table of the literature, PMC6925591, table 1",
        measured=True,
        place=_on_liver("sound_speed", _scaled),
        central=_of_fresh_liver("sound_speed"),
    ),
    Spread(
        name="liver_modulus",
        label="moduli of liver",
        unit="Pa",
        relative_sd=0.4 / 1.8,
        distribution="log-normal",
        source="shear modulus of 1.8 +- 0.4 kPa, table of the literature, PMC6925591, table 1 (shear waves of 1.65 +- "
        "0.18 m/s in bovine liver say 22 % too, PMC6414262; instantaneous modulus of porcine liver: 2.65 +- 0.30 kPa, "
        "Mattei et al. 2014, abstract)",
        measured=True,
        place=_stiffer_liver,
        central=_liver_modulus,
    ),
    Spread(
        name="lesion_modulus",
        label="moduli of the lesion",
        unit="Pa",
        relative_sd=2.0 * 0.18 / 2.52,
        distribution="log-normal",
        source="shear waves of 2.52 +- 0.18 m/s in ablated bovine liver, modulus as their square; between the pixels "
        "of an image, taken for the spread between lesions, PMC6414262, abstract",
        measured=True,
        place=_stiffer_lesion,
        central=lambda model: float(jnp.asarray(model.lesion.viscoelasticity(LESION_TEMPERATURE).unrelaxed_modulus)),
    ),
    Spread(
        name="liver_specific_heat",
        label="specific heat of liver",
        unit="J/(kg K)",
        relative_sd=0.03,
        distribution="normal",
        source="assumed from how far three studies are apart at 37 degC: 3540 J/(kg K) (COMSOL bioheat library), 3570 "
        "(line of Haemmerich et al. 2006) and 3365 (3.567 MJ/(m^3 K) of Guntur et al. 2013 over 1060 kg/m^3)",
        measured=False,
        place=_on_liver("specific_heat", _scaled),
        central=_of_fresh_liver("specific_heat"),
    ),
    Spread(
        name="liver_conductivity",
        label="thermal conductivity of liver",
        unit="W/(m K)",
        relative_sd=0.05,
        distribution="normal",
        source="assumed: half of the 9.6 % by which it changes from 20 to 35 degC, Guntur et al. 2013, abstract; no "
        "spread between livers is stated",
        measured=False,
        place=_on_liver("conductivity", _scaled),
        central=_of_fresh_liver("conductivity"),
    ),
)
"""The constants that vary."""

FIXED = (
    "perfusion of liver",
    "relaxation times of liver and lesion",
    "Poisson's ratio and density of liver",
    "exponent of attenuation, B/A and the share of attenuation that absorbs",
    "rate at which the lesion stiffens with temperature",
    "lethal dose, and the edge of the lesion",
    "thickness and constants of the layers in front of the liver",
    "transducer, power and start temperature",
)
"""What does not vary, because no measured spread of it is at hand, or because it is not tissue."""
