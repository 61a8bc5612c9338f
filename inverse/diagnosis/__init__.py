"""What the simulation gets wrong, by name, and what fixing it is worth."""

from inverse.diagnosis.cause import DmaCause as DmaCause
from inverse.diagnosis.causes import DMA_CAUSES as DMA_CAUSES
from inverse.diagnosis.diagnosis import VERDICTS as VERDICTS
from inverse.diagnosis.diagnosis import CauseReport as CauseReport
from inverse.diagnosis.diagnosis import Diagnosis as Diagnosis
from inverse.diagnosis.diagnosis import diagnose_dma as diagnose_dma
from inverse.diagnosis.where import describe_correction as describe_correction
