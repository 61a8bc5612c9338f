"""The measurement that would tell causes apart which the present one cannot."""

from inverse.design.design import Design as Design
from inverse.design.dma_design import design_dma as design_dma
from inverse.design.hmi_design import design_hmi as design_hmi
