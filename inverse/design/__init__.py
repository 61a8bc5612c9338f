"""The measurement that would tell causes apart which the present one cannot."""

from inverse.design.dma_design import Design as Design
from inverse.design.dma_design import design_dma as design_dma
