"""What the simulation gets wrong, by name, and what fixing it is worth."""

from inverse.diagnosis.diagnosis import VERDICTS as VERDICTS
from inverse.diagnosis.diagnosis import CauseReport as CauseReport
from inverse.diagnosis.diagnosis import Diagnosis as Diagnosis
from inverse.diagnosis.dma.cause import DmaCause as DmaCause
from inverse.diagnosis.dma.causes import DMA_CAUSES as DMA_CAUSES
from inverse.diagnosis.dma.diagnosis import diagnose_dma as diagnose_dma
from inverse.diagnosis.hmi.cause import HmiCause as HmiCause
from inverse.diagnosis.hmi.causes import HMI_CAUSES as HMI_CAUSES
from inverse.diagnosis.hmi.diagnosis import diagnose_hmi as diagnose_hmi
