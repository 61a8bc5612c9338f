"""Named causes of misfit of curves of displacement, one small file each."""

from inverse.diagnosis.hmi.cause import HmiCause
from inverse.diagnosis.hmi.causes.acoustic_saturation import AcousticSaturation
from inverse.diagnosis.hmi.causes.attenuation_kinetics import AttenuationKinetics
from inverse.diagnosis.hmi.causes.boiling import Boiling
from inverse.diagnosis.hmi.causes.cavitation import Cavitation
from inverse.diagnosis.hmi.causes.conductivity_change import ConductivityChange
from inverse.diagnosis.hmi.causes.damage_law import DamageLaw
from inverse.diagnosis.hmi.causes.echo_strain import EchoStrain
from inverse.diagnosis.hmi.causes.exponent_change import ExponentChange
from inverse.diagnosis.hmi.causes.fractional_tissue import FractionalTissue
from inverse.diagnosis.hmi.causes.lesion_rim import LesionRim
from inverse.diagnosis.hmi.causes.lesion_stiffness_law import LesionStiffnessLaw
from inverse.diagnosis.hmi.causes.near_boundary import NearBoundary
from inverse.diagnosis.hmi.causes.normalisation_temperature import NormalisationTemperature
from inverse.diagnosis.hmi.causes.output_drift import OutputDrift
from inverse.diagnosis.hmi.causes.path_heating import PathHeating
from inverse.diagnosis.hmi.causes.perfusion import Perfusion
from inverse.diagnosis.hmi.causes.pre_ablation_softening import PreAblationSoftening
from inverse.diagnosis.hmi.causes.scattering_fraction import ScatteringFraction
from inverse.diagnosis.hmi.causes.sound_speed_change import SoundSpeedChange
from inverse.diagnosis.hmi.causes.thermal_decorrelation import ThermalDecorrelation
from inverse.diagnosis.hmi.causes.thermal_lens import ThermalLens
from inverse.diagnosis.hmi.causes.thermocouple_lag import ThermocoupleLag
from inverse.diagnosis.hmi.causes.thermocouple_position import ThermocouplePosition
from inverse.diagnosis.hmi.causes.thermocouple_viscous_heating import ThermocoupleViscousHeating
from inverse.diagnosis.hmi.causes.tracking_compression import TrackingCompression
from inverse.diagnosis.hmi.causes.tracking_jitter import TrackingJitter

HMI_CAUSES: tuple[HmiCause, ...] = (
    ThermocoupleViscousHeating(),
    ThermocoupleLag(),
    ThermocouplePosition(),
    NormalisationTemperature(),
    TrackingCompression(),
    TrackingJitter(),
    ThermalDecorrelation(),
    EchoStrain(),
    ThermalLens(),
    PathHeating(),
    AttenuationKinetics(),
    ScatteringFraction(),
    ExponentChange(),
    SoundSpeedChange(),
    Perfusion(),
    ConductivityChange(),
    PreAblationSoftening(),
    LesionRim(),
    DamageLaw(),
    LesionStiffnessLaw(),
    FractionalTissue(),
    Cavitation(),
    Boiling(),
    OutputDrift(),
    AcousticSaturation(),
    NearBoundary(),
)
"""From the thermometer over the sound to the tissue."""
