"""The paper's own numbers beside what its tables, its equations and this simulation give.

Nothing is tuned to agree: each row states what the paper says, what comes out here, and why they differ where they do.
Where the paper is silent the literal reading is the default, and `readings` says what every other one gives.
"""

from inverse.reproduction.attenuation import attenuation_rows as attenuation_rows
from inverse.reproduction.attenuation import force_of_plane_wave as force_of_plane_wave
from inverse.reproduction.attenuation import lowest_of_polynomial as lowest_of_polynomial
from inverse.reproduction.attenuation import rounding_of_polynomial as rounding_of_polynomial
from inverse.reproduction.beam import BeamSize as BeamSize
from inverse.reproduction.beam import beam_rows as beam_rows
from inverse.reproduction.beam import beam_size as beam_size
from inverse.reproduction.beam import beam_sizes as beam_sizes
from inverse.reproduction.bench import TEMPERATURES as TEMPERATURES
from inverse.reproduction.bench import Bench as Bench
from inverse.reproduction.bench import Case as Case
from inverse.reproduction.counts import count_rows as count_rows
from inverse.reproduction.counts import falls_and_rises as falls_and_rises
from inverse.reproduction.displacement import displacement_rows as displacement_rows
from inverse.reproduction.displacement import percent_of_first as percent_of_first
from inverse.reproduction.dose import dose_rows as dose_rows
from inverse.reproduction.dose import lethal_moment as lethal_moment
from inverse.reproduction.dose import lethal_temperature_of_ramp as lethal_temperature_of_ramp
from inverse.reproduction.dose import simulated_dose_rows as simulated_dose_rows
from inverse.reproduction.finite_element_table import lesion_constant_rows as lesion_constant_rows
from inverse.reproduction.finite_element_table import mean_relaxed_modulus as mean_relaxed_modulus
from inverse.reproduction.finite_element_table import regressions as regressions
from inverse.reproduction.finite_element_table import relaxed_share as relaxed_share
from inverse.reproduction.layer_table import layer_rows as layer_rows
from inverse.reproduction.layer_table import temperature_of_water as temperature_of_water
from inverse.reproduction.layer_table import water_sound_speed as water_sound_speed
from inverse.reproduction.lesion import lesion_size_rows as lesion_size_rows
from inverse.reproduction.lesion import sizes_by_dose as sizes_by_dose
from inverse.reproduction.moduli import TABLES as TABLES
from inverse.reproduction.moduli import loss_tangent as loss_tangent
from inverse.reproduction.moduli import modulus_from_rounding as modulus_from_rounding
from inverse.reproduction.moduli import modulus_magnitude as modulus_magnitude
from inverse.reproduction.moduli import modulus_rows as modulus_rows
from inverse.reproduction.moduli import relaxed_modulus_for as relaxed_modulus_for
from inverse.reproduction.motion import measured_rows as measured_rows
from inverse.reproduction.motion import vibration_percent as vibration_percent
from inverse.reproduction.readings import GAUSSIAN as GAUSSIAN
from inverse.reproduction.readings import Reading as Reading
from inverse.reproduction.readings import all_readings as all_readings
from inverse.reproduction.readings import beams as beams
from inverse.reproduction.readings import find as find
from inverse.reproduction.readings import reading as reading
from inverse.reproduction.row import Row as Row
from inverse.reproduction.second_study import SecondStudy as SecondStudy
from inverse.reproduction.second_study import insensitivity as insensitivity
from inverse.reproduction.second_study import insensitivity_rows as insensitivity_rows
from inverse.reproduction.second_study import run_second_study as run_second_study
from inverse.reproduction.second_study import second_study_rows as second_study_rows
from inverse.reproduction.sound import Overview as Overview
from inverse.reproduction.sound import overview as overview
from inverse.reproduction.variations import Variation as Variation
from inverse.reproduction.variations import largest as largest
from inverse.reproduction.variations import lesion_variations as lesion_variations
from inverse.reproduction.variations import variation_rows as variation_rows
from inverse.reproduction.zener_table import error_ratios as error_ratios
from inverse.reproduction.zener_table import fitted_frequencies as fitted_frequencies
from inverse.reproduction.zener_table import refit as refit
from inverse.reproduction.zener_table import relaxed_modulus_uncertainty as relaxed_modulus_uncertainty
from inverse.reproduction.zener_table import sum_of_squares as sum_of_squares
from inverse.reproduction.zener_table import zener_rows as zener_rows
