"""Figures of fits, each a `Figure` of its own: nothing of pyplot, which would keep them."""

from inverse.figures.calibration import draw_calibration as draw_calibration
from inverse.figures.diagnosis import diagnosis_figure as diagnosis_figure
from inverse.figures.dma import dma_figure as dma_figure
from inverse.figures.heating import heating_figure as heating_figure
from inverse.figures.paper import draw_attenuation as draw_attenuation
from inverse.figures.paper import draw_displacements as draw_displacements
from inverse.figures.paper import draw_paper_moduli as draw_paper_moduli
from inverse.figures.posterior import dma_panels as dma_panels
from inverse.figures.posterior import draw_corner as draw_corner
from inverse.figures.posterior import draw_overlap as draw_overlap
from inverse.figures.posterior import draw_predictions as draw_predictions
from inverse.figures.posterior import draw_traces as draw_traces
from inverse.figures.variability import draw_bands as draw_bands
from inverse.figures.variability import draw_sensitivity as draw_sensitivity
