"""The numbers of Suomi et al. 2016, as printed, under the number of the table or figure that holds them.

V. Suomi, Y. Han, E. Konofagou, R. Cleveland, "The effect of temperature dependent tissue parameters on acoustic
radiation force induced displacements", Phys. Med. Biol. 61 (2016) 7427; author's manuscript under CC BY 3.0.
Units are those of the names, so that each number can be held against the page.
"""

from typing import Final, NamedTuple

PAPER: Final = "Suomi et al. 2016"


class AcousticRow(NamedTuple):
    """A row of table 1."""

    density: float
    sound_speed: float
    attenuation_db_per_cm_mhz: float
    absorption_exponent: float
    nonlinearity_parameter: float


class ZenerRow(NamedTuple):
    """A row of table 2; the conventional model has order 1."""

    lowest_frequency_hz: float
    highest_frequency_hz: float
    unrelaxed_modulus_kpa: float
    relaxed_modulus_pa: float
    relaxation_time: float
    fractional_order: float
    sum_of_squared_errors: float


class LesionColumn(NamedTuple):
    """A column of table 3, for one temperature of the lesion."""

    relaxed_modulus_pa: float
    branch_modulus_kpa: float
    relaxation_time: float
    length_mm: float
    diameter_mm: float


class MotionImagingText(NamedTuple):
    """Section "Thermal ablation monitoring using harmonic motion imaging": the imaging transducer and what it does."""

    imaging_frequency_mhz: float
    imaging_diameter_mm: float
    lowest_frequency_mhz: float
    highest_frequency_mhz: float
    focal_length_mm: float
    sampling_frequency_mhz: float
    pulse_repetition_frequency_hz: float
    modulation_frequency_hz: float
    averaged_samples: int
    reference_temperature: float


TABLE_1_ACOUSTIC: Final = {
    "water": AcousticRow(1000.0, 1482.0, 0.00217, 2.00, 5.0),
    "skin": AcousticRow(1090.0, 1615.0, 0.35, 1.55, 7.9),
    "fat": AcousticRow(950.0, 1478.0, 0.48, 1.20, 10.0),
    "muscle": AcousticRow(1050.0, 1547.0, 1.09, 1.10, 7.4),
    "liver": AcousticRow(1060.0, 1584.0, 0.35, 1.00, 7.2),
}
"""Acoustic simulation parameters at 35 degC, by tissue."""

TABLE_2_ZENER: Final = {
    21.0: ZenerRow(0.6, 31.6, 2.1, 1351.1, 3.45e-2, 1.0, 0.008),
    35.0: ZenerRow(0.1, 17.8, 2.0, 1102.3, 3.09e-1, 1.0, 0.044),
    50.0: ZenerRow(0.1, 31.6, 15.0, 8.0, 4.62e-1, 1.0, 0.237),
    65.0: ZenerRow(0.1, 56.0, 99.1, 8.1, 6.74e-1, 1.0, 0.349),
    80.0: ZenerRow(0.1, 100.0, 138.0, 8.1, 9.32e-1, 1.0, 0.366),
}
"""Conventional Zener constants of thermally ablated liver, by temperature [degC]."""

TABLE_2_FRACTIONAL_ZENER: Final = {
    21.0: ZenerRow(0.6, 31.6, 3.0, 855.2, 1.23e-2, 0.40, 0.000),
    35.0: ZenerRow(0.1, 17.8, 2.5, 8.0, 7.52e-1, 0.38, 0.014),
    50.0: ZenerRow(0.1, 31.6, 20.2, 8.1, 2.24e-1, 0.55, 0.011),
    65.0: ZenerRow(0.1, 56.0, 171.2, 8.1, 9.99e-2, 0.32, 0.002),
    80.0: ZenerRow(0.1, 100.0, 335.5, 8.1, 5.20e-3, 0.19, 0.002),
}
"""Fractional Zener constants of thermally ablated liver, by temperature [degC]."""

TABLE_3_LIVER_RELAXED_MODULUS_KPA: Final = 1.1
"""Printed as 1.1 Pa; 1.1 kPa is meant, since with the branch of 0.9 kPa it makes the 2.0 kPa of table 2 at 35 degC."""

TABLE_3_LIVER_RELAXED_MODULUS_AS_PRINTED_PA: Final = 1.1
"""The same number in the unit that stands there."""

TABLE_3_LIVER_BRANCH_MODULUS_KPA: Final = 0.9
TABLE_3_LIVER_RELAXATION_TIME: Final = 0.309

TABLE_3_LESION: Final = {
    60.0: LesionColumn(8.1, 34.7, 0.626, 3.0, 0.6),
    65.0: LesionColumn(8.1, 52.6, 0.699, 5.0, 1.2),
    70.0: LesionColumn(8.1, 79.6, 0.772, 6.8, 1.7),
}
"""Lesion of the finite-element model, by temperature [degC]."""

POISSON_RATIO: Final = 0.499
"""Of liver and lesion (text, "Simulations of thermal ablation")."""

FIGURE_ATTENUATION_COEFFICIENTS: Final = (1.23e2, 1.99, -1.41e-1, 1.94e-3, -2.55e-6)
"""Attenuation normalised to 37 degC [percent, percent/K, ...], p_0 to p_4 (caption of the figure of the fit)."""

FIGURE_ATTENUATION_RANGE: Final = (5.0, 70.0)
"""Temperatures [degC] over which the polynomial was fitted."""

TEXT_SIMULATED_DISPLACEMENT_PERCENT: Final = {40.0: 95.0, 45.0: 95.0, 55.0: 105.0, 60.0: 85.0, 70.0: 49.0}
"""Simulated displacement normalised to 35 degC, by temperature [degC], as the results' text states it."""

TEXT_MODULUS_KPA: Final = {
    ("zener", 21.0, 0.1): 1.4,
    ("zener", 35.0, 0.1): 1.2,
    ("zener", 21.0, 200.0): 2.0,
    ("zener", 35.0, 200.0): 2.0,
    ("zener", 50.0, 0.1): 5.0,
    ("zener", 50.0, 200.0): 15.0,
    ("zener", 65.0, 0.1): 40.0,
    ("zener", 65.0, 200.0): 100.0,
    ("zener", 80.0, 0.1): 70.0,
    ("zener", 80.0, 200.0): 140.0,
    ("fractional-zener", 21.0, 0.1): 1.2,
    ("fractional-zener", 35.0, 0.1): 1.2,
    ("fractional-zener", 21.0, 200.0): 2.4,
    ("fractional-zener", 35.0, 200.0): 2.4,
    ("fractional-zener", 50.0, 200.0): 19.0,
    ("fractional-zener", 65.0, 200.0): 140.0,
    ("fractional-zener", 80.0, 200.0): 200.0,
}
"""Magnitude of the modulus that the text reads off its curves, by model, temperature [degC] and frequency [Hz].

Where it gives one range for two curves ("1.2-1.4 kPa" at 21 and 35 degC) the ends stand here, the lower for the lower.
"""

TEXT_MOTION_IMAGING: Final = MotionImagingText(7.5, 16.5, 5.84, 8.66, 90.0, 100.0, 1000.0, 50.0, 25, 37.0)
"""The focal length is that of the bowl around it; whether the imaging transducer is focused, and how long the window of
its cross-correlation was, the paper does not say."""

TEXT_MEASURED_FALL_PERCENT: Final = (6.0, 42.0)
"""Range of the decrease of measured displacement (discussion)."""

TEXT_MEASURED_RISE_PERCENT: Final = (3.0, 5.0)
"""Range of the increase before it (discussion)."""

TEXT_MEASURED_DIP_PERCENT: Final = 1.0
"""Average decrease before that, "about" (discussion)."""

TEXT_LESION_VARIATION: Final = {"attenuation": 0.25, "modulus": 0.25, "sound speed": 0.005, "exponent": 0.25}
"""By how much constants of the lesion were changed, as shares of themselves."""

TEXT_ATTENUATION_VARIATION_POINTS: Final = 0.1
"""Change of the normalised displacement that it stayed below [percent points]."""

TEXT_MODULUS_VARIATION_POINTS: Final = 2.0
"""Change of the normalised displacement at 70 degC, "approximately" [percent points]."""

SECOND_STUDY_MODULUS_KPA: Final = (5.0, 155.0)
SECOND_STUDY_ATTENUATION_DB_PER_CM: Final = (0.15, 1.35)
SECOND_STUDY_RELAXED_MODULUS_PA: Final = 8.0
SECOND_STUDY_RELAXATION_TIME: Final = 0.5
SECOND_STUDY_UNABLATED_UM: Final = 9.0
SECOND_STUDY_ABLATED_UM: Final = 6.0
SECOND_STUDY_DECREASE_PERCENT: Final = 30.0
"""Second study: ranges of both axes, constants that it keeps, and displacement for the average values before and after
ablation, which the text does not state (its figures of the literature do)."""

TEXT_ABLATION_ATTENUATION_RATIO: Final = 2.1
"""Attenuation of ablated over that of fresh liver, on average ("increases by approximately 110 percent")."""

TEXT_ABLATION_MODULUS_RATIO: Final = (4.0, 8.0)
"""Young's modulus of ablated over that of fresh liver, by author."""
