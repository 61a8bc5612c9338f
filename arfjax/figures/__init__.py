"""Pictures of fields, heating and displacement; the only folder of the package that draws."""

from arfjax.figures.heating import draw_heating as draw_heating
from arfjax.figures.heating import draw_lesion_on_force as draw_lesion_on_force
from arfjax.figures.heating import draw_sonication as draw_sonication
from arfjax.figures.heating import draw_temperature_maps as draw_temperature_maps
from arfjax.figures.motion import draw_displacement as draw_displacement
from arfjax.figures.motion import draw_monitoring as draw_monitoring
from arfjax.figures.motion import draw_push as draw_push
from arfjax.figures.motion import draw_vibration as draw_vibration
from arfjax.figures.sound import draw_field as draw_field
from arfjax.figures.sound import draw_sound as draw_sound
from arfjax.figures.style import COLOURS as COLOURS
from arfjax.figures.style import new_figure as new_figure
from arfjax.figures.style import tidy as tidy
