"""Figures in the form of the paper's, from its own numbers and from this simulation."""

from inverse.figures.paper_displacement import draw_displacements as draw_displacements
from inverse.figures.paper_displacement import draw_ladder as draw_ladder
from inverse.figures.paper_displacement import draw_readings as draw_readings
from inverse.figures.paper_fields import draw_geometry as draw_geometry
from inverse.figures.paper_fields import draw_lesions_on_force as draw_lesions_on_force
from inverse.figures.paper_fields import draw_second_study as draw_second_study
from inverse.figures.paper_tables import draw_attenuation as draw_attenuation
from inverse.figures.paper_tables import draw_loss_tangents as draw_loss_tangents
from inverse.figures.paper_tables import draw_paper_moduli as draw_paper_moduli
