"""Named causes, one small file each."""

from inverse.diagnosis.cause import DmaCause
from inverse.diagnosis.causes.bath_viscosity import BathViscosity
from inverse.diagnosis.causes.clamp_compliance import ClampCompliance
from inverse.diagnosis.causes.drying import Drying
from inverse.diagnosis.causes.frame_resonance import FrameResonance
from inverse.diagnosis.causes.instrument_inertia import InstrumentInertia
from inverse.diagnosis.causes.noise_floor import NoiseFloor
from inverse.diagnosis.causes.phase_delay import PhaseDelay
from inverse.diagnosis.causes.poroelastic_drainage import PoroelasticDrainage
from inverse.diagnosis.causes.power_law_relaxation import PowerLawRelaxation
from inverse.diagnosis.causes.second_relaxation import SecondRelaxation
from inverse.diagnosis.causes.slip import Slip
from inverse.diagnosis.causes.strain_nonlinearity import StrainNonlinearity
from inverse.diagnosis.causes.sweep_drift import SweepDrift
from inverse.diagnosis.causes.temperature_lag import TemperatureLag

DMA_CAUSES: tuple[DmaCause, ...] = (
    InstrumentInertia(),
    ClampCompliance(),
    FrameResonance(),
    PhaseDelay(),
    NoiseFloor(),
    Slip(),
    SweepDrift(),
    Drying(),
    BathViscosity(),
    TemperatureLag(),
    SecondRelaxation(),
    PowerLawRelaxation(),
    PoroelasticDrainage(),
    StrainNonlinearity(),
)
"""Causes of misfit of a dynamic mechanical analysis."""
