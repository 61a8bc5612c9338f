"""Named tissues: every property a law of temperature with its source.

Acoustic constants are table 1 of Suomi et al. 2016. The paper gives no thermal constants. Those here are the values
in common use (those of the IT'IS tissue database, not checked against it), an assumption of this package except for
liver, whose conductivity and specific heat are those of the COMSOL bioheat library.
"""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp

from arfjax import suomi2016
from arfjax.laws import (
    LETHAL_DOSE_MINUTES,
    Coagulating,
    Constant,
    Exponential,
    FractionalZenerLaw,
    Linear,
    NormalisedPolynomial,
    Scaled,
    Tabulated,
    Temperature,
    TemperatureLaw,
    ViscoelasticLaw,
    ZenerLaw,
)
from arfjax.media import AcousticMedium, Scalar, ThermalMedium
from arfjax.units import from_db_per_cm

BLOOD_DENSITY = 1050.0  # kg/m^3; value in common use, assumed
BLOOD_SPECIFIC_HEAT = 3617.0  # J/(kg K); value in common use, assumed

COAGULATION_WIDTH = 0.25  # a tenth at 139 min, nine tenths at 416; assumed

_TABLE_1 = f"{suomi2016.PAPER}, table 1"
_ASSUMED = "value in common use, assumed"


class Tissue(eqx.Module):
    """A layer's properties as laws of temperature.

    Attributes:
        density: [kg/m^3].
        sound_speed: [m/s].
        attenuation: Amplitude attenuation coefficient at 1 MHz [Np/m].
        absorption_exponent: Power of frequency in attenuation [1].
        nonlinearity_parameter: B/A [1].
        conductivity: [W/(m K)].
        specific_heat: [J/(kg K)].
        perfusion_rate: Volume of blood per volume of tissue and time [1/s].
        metabolic_heat: Heat that tissue makes itself [W/m^3].
        viscoelasticity: Zener constants; None for a layer whose motion is not simulated.
        absorption_fraction: Share of attenuation that is absorption and heats; the rest scatters [1].
    """

    density: TemperatureLaw
    sound_speed: TemperatureLaw
    attenuation: TemperatureLaw
    absorption_exponent: TemperatureLaw
    nonlinearity_parameter: Scalar
    conductivity: TemperatureLaw
    specific_heat: TemperatureLaw
    perfusion_rate: TemperatureLaw
    metabolic_heat: TemperatureLaw = Constant(0.0, unit="W/m^3", source="left out, as small beside ultrasound")
    viscoelasticity: ViscoelasticLaw | None = None
    absorption_fraction: TemperatureLaw = Constant(1.0, unit="1", source="all attenuation absorbs, as in the paper")

    def acoustic(self, temperature: Temperature, dose: Temperature = 0.0) -> AcousticMedium:
        """Acoustic constants at a temperature [degC] and after a thermal dose [equivalent min at 43 degC]."""
        return AcousticMedium(
            density=self.density(temperature, dose),
            sound_speed=self.sound_speed(temperature, dose),
            attenuation=self.attenuation(temperature, dose),
            absorption_exponent=self.absorption_exponent(temperature, dose),
            nonlinearity_parameter=self.nonlinearity_parameter,
            absorption_fraction=self.absorption_fraction(temperature, dose),
        )

    def thermal(self, temperature: Temperature, dose: Temperature = 0.0) -> ThermalMedium:
        """Thermal constants at a temperature [degC] and after a thermal dose [equivalent min at 43 degC]."""
        return ThermalMedium(
            conductivity=self.conductivity(temperature, dose),
            heat_capacity=self.density(temperature, dose) * self.specific_heat(temperature, dose),
            perfusion_conductance=self.perfusion_rate(temperature, dose) * BLOOD_DENSITY * BLOOD_SPECIFIC_HEAT,
            metabolic_heat=self.metabolic_heat(temperature, dose),
        )


def _tissue(name: str, conductivity: float, specific_heat: float, perfusion_kg_per_m3_s: float) -> Tissue:
    row = suomi2016.TABLE_1_ACOUSTIC[name]
    return Tissue(
        density=Constant(row.density, unit="kg/m^3", source=_TABLE_1),
        sound_speed=Constant(row.sound_speed, unit="m/s", source=_TABLE_1),
        attenuation=Constant(from_db_per_cm(row.attenuation_db_per_cm_mhz), unit="Np/m", source=_TABLE_1),
        absorption_exponent=Constant(row.absorption_exponent, unit="1", source=_TABLE_1),
        nonlinearity_parameter=row.nonlinearity_parameter,
        conductivity=Constant(conductivity, unit="W/(m K)", source=_ASSUMED),
        specific_heat=Constant(specific_heat, unit="J/(kg K)", source=_ASSUMED),
        perfusion_rate=Constant(perfusion_kg_per_m3_s / BLOOD_DENSITY, unit="1/s", source=_ASSUMED),
    )


def water() -> Tissue:
    """Water: the paper's row, which is water at 20 degC, although the table says 35."""
    return _tissue("water", 0.60, 4180.0, 0.0)


def skin() -> Tissue:
    """Skin."""
    return _tissue("skin", 0.37, 3391.0, 1.96)


def fat() -> Tissue:
    """Subcutaneous fat."""
    return _tissue("fat", 0.21, 2348.0, 0.50)


def muscle() -> Tissue:
    """Muscle."""
    return _tissue("muscle", 0.49, 3421.0, 0.67)


def liver() -> Tissue:
    """Liver, with attenuation by the paper's polynomial."""
    tissue = _tissue("liver", 0.52, 3540.0, 15.2)
    return dataclasses.replace(tissue, attenuation=liver_attenuation(), viscoelasticity=liver_viscoelasticity())


def liver_attenuation() -> NormalisedPolynomial:
    """Attenuation of liver at 1 MHz [Np/m]: the paper's polynomial times its 0.35 dB/(cm MHz).

    The polynomial is normalised to 37 degC, where its rounded coefficients give 97.1 percent, while the table says
    "at 35 degC", where they give 99.3; here, as in the paper, neither is corrected.
    """
    return NormalisedPolynomial(
        from_db_per_cm(suomi2016.TABLE_1_ACOUSTIC["liver"].attenuation_db_per_cm_mhz),
        jnp.asarray(suomi2016.FIGURE_ATTENUATION_COEFFICIENTS),
        unit="Np/m",
        source=f"{suomi2016.PAPER}, table 1 and attenuation polynomial",
        valid_range=suomi2016.FIGURE_ATTENUATION_RANGE,
    )


def liver_viscoelasticity() -> ZenerLaw:
    """Unablated liver of the paper's finite-element model (table 3), the same at all temperatures."""
    source = f"{suomi2016.PAPER}, table 3"
    return ZenerLaw(
        relaxed_modulus=Constant(1e3 * suomi2016.TABLE_3_LIVER_RELAXED_MODULUS_KPA, unit="Pa", source=source),
        branch_modulus=Constant(1e3 * suomi2016.TABLE_3_LIVER_BRANCH_MODULUS_KPA, unit="Pa", source=source),
        relaxation_time=Constant(suomi2016.TABLE_3_LIVER_RELAXATION_TIME, unit="s", source=source),
    )


def lesion_viscoelasticity() -> ZenerLaw:
    """Lesion as a smooth law: stiffness exponential and relaxation time linear in temperature.

    Table 3 lies on these lines to its last digit: its values are regressions over the temperatures of table 2.
    """
    source = f"{suomi2016.PAPER}, regression through table 3"
    columns = suomi2016.TABLE_3_LESION
    (low, first), (_, middle), (high, last) = sorted(columns.items())
    valid = (low, high)
    rate = float(jnp.log(last.branch_modulus_kpa / first.branch_modulus_kpa)) / (high - low)
    return ZenerLaw(
        relaxed_modulus=Constant(middle.relaxed_modulus_pa, unit="Pa", source=source),
        branch_modulus=Exponential(
            1e3 * middle.branch_modulus_kpa, rate, 65.0, unit="Pa", source=source, valid_range=valid
        ),
        relaxation_time=Linear(
            middle.relaxation_time,
            (last.relaxation_time - first.relaxation_time) / (high - low),
            65.0,
            unit="s",
            source=source,
            valid_range=valid,
        ),
    )


def fractional_liver_viscoelasticity() -> FractionalZenerLaw:
    """Unablated liver as the fractional Zener solid of table 2 at 35 degC, the same at all temperatures."""
    row = suomi2016.TABLE_2_FRACTIONAL_ZENER[35.0]
    source = f"{suomi2016.PAPER}, table 2"
    return FractionalZenerLaw(
        relaxed_modulus=Constant(row.relaxed_modulus_pa, unit="Pa", source=source),
        branch_modulus=Constant(1e3 * row.unrelaxed_modulus_kpa - row.relaxed_modulus_pa, unit="Pa", source=source),
        relaxation_time=Constant(row.relaxation_time, unit="s", source=source),
        fractional_order=Constant(row.fractional_order, unit="1", source=source),
    )


def fractional_lesion_viscoelasticity() -> FractionalZenerLaw:
    """Lesion as the fractional Zener solid of table 2 at 50, 65 and 80 degC, straight lines in between (ours).

    The paper's own simulations have the conventional solid only. Relaxed moduli of 8.1 Pa are a bound or a start of its
    fits, not a measurement; neither pushes nor shaking at 50 Hz feel them.
    """
    rows = {at: row for at, row in sorted(suomi2016.TABLE_2_FRACTIONAL_ZENER.items()) if at >= 50.0}
    temperatures = jnp.asarray(list(rows))
    source = f"{suomi2016.PAPER}, table 2, linear in between"

    def law(values: list[float], unit: str) -> Tabulated:
        return Tabulated(temperatures, jnp.asarray(values), unit=unit, source=source, valid_range=(50.0, 80.0))

    each = list(rows.values())
    return FractionalZenerLaw(
        relaxed_modulus=law([row.relaxed_modulus_pa for row in each], "Pa"),
        branch_modulus=law([1e3 * row.unrelaxed_modulus_kpa - row.relaxed_modulus_pa for row in each], "Pa"),
        relaxation_time=law([row.relaxation_time for row in each], "s"),
        fractional_order=law([row.fractional_order for row in each], "1"),
    )


def unperfused(tissue: Tissue) -> Tissue:
    """The same tissue without blood flow, as in a sample."""
    return dataclasses.replace(tissue, perfusion_rate=Constant(0.0, unit="1/s", source="no blood flow"))


def coagulating(tissue: Tissue, *, width: float = COAGULATION_WIDTH) -> Tissue:
    """The same tissue, whose perfusion stops where it coagulates, at a dose of 240 min.

    Args:
        tissue: Fresh.
        width: Of the transition in the logarithm of dose. An assumption: vessels are known to close at lethal doses,
            the number is ours.
    """
    stopped = Coagulating(
        tissue.perfusion_rate,
        Constant(0.0, unit="1/s", source="no blood flows in coagulated tissue"),
        LETHAL_DOSE_MINUTES,
        width,
        unit="1/s",
        source=f"{tissue.perfusion_rate.source}; none above the lethal dose",
    )
    return dataclasses.replace(tissue, perfusion_rate=stopped)


def attenuating(tissue: Tissue) -> Tissue:
    """The same tissue, whose attenuation doubles as it coagulates, beyond what its temperature does.

    In dog tissues attenuation doubled over doses of 100 to 1000 min, which are taken for a tenth and nine tenths of
    the way. A law of temperature that was measured while tissue coagulated, as the paper's polynomial was, has that
    rise in it already above 60 degC.
    """
    source = "Damianou et al., J. Acoust. Soc. Am. 102 (1997) 628, abstract"
    changing = Coagulating(
        tissue.attenuation,
        Scaled(tissue.attenuation, 2.0, unit="Np/m", source=source, valid_range=tissue.attenuation.valid_range),
        math.sqrt(100.0 * 1000.0),
        math.log(10.0) / math.log(81.0),
        unit="Np/m",
        source=f"{tissue.attenuation.source}; doubling: {source}",
        valid_range=tissue.attenuation.valid_range,
    )
    return dataclasses.replace(tissue, attenuation=changing)


def warming(tissue: Tissue) -> Tissue:
    """The same tissue with conductivity and specific heat of liver as they were measured from 20 to 90 degC.

    Conductivity falls by 9.6 percent from 20 degC to its lowest, 0.520 W/(m K) at 35 to 40, and rises by 45 percent
    from there to 90, taken to be linear. Specific heat is the line through its two printed values, which are 23 percent
    apart, not 17 as printed beside them. Both stand for other soft tissue only as an assumption.
    """
    return dataclasses.replace(
        tissue,
        conductivity=Tabulated(
            jnp.asarray([20.0, 35.0, 40.0, 90.0]),
            jnp.asarray([0.520 / 0.904, 0.520, 0.520, 1.45 * 0.520]),
            unit="W/(m K)",
            source="porcine liver ex vivo, Guntur et al., Ultrasound Med. Biol. (2013), abstract",
            valid_range=(20.0, 90.0),
        ),
        specific_heat=Linear(
            3411.0,
            (4187.0 - 3411.0) / (83.5 - 25.0),
            25.0,
            unit="J/(kg K)",
            source="liver, Haemmerich et al. (2006), abstract",
            valid_range=(25.0, 83.5),
        ),
    )


BY_NAME = {"water": water, "skin": skin, "fat": fat, "muscle": muscle, "liver": liver}
"""The named tissues that an experiment file may ask for."""
