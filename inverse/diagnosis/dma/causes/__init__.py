"""Named causes, one small file each."""

from inverse.diagnosis.dma.cause import DmaCause
from inverse.diagnosis.dma.causes.bath_viscosity import BathViscosity
from inverse.diagnosis.dma.causes.clamp_compliance import ClampCompliance
from inverse.diagnosis.dma.causes.drying import Drying
from inverse.diagnosis.dma.causes.frame_resonance import FrameResonance
from inverse.diagnosis.dma.causes.instrument_inertia import InstrumentInertia
from inverse.diagnosis.dma.causes.noise_floor import NoiseFloor
from inverse.diagnosis.dma.causes.phase_delay import PhaseDelay
from inverse.diagnosis.dma.causes.poroelastic_drainage import PoroelasticDrainage
from inverse.diagnosis.dma.causes.power_law_relaxation import PowerLawRelaxation
from inverse.diagnosis.dma.causes.second_relaxation import SecondRelaxation
from inverse.diagnosis.dma.causes.slip import Slip
from inverse.diagnosis.dma.causes.strain_nonlinearity import StrainNonlinearity
from inverse.diagnosis.dma.causes.sweep_drift import SweepDrift
from inverse.diagnosis.dma.causes.temperature_lag import TemperatureLag

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
