"""Differentiable simulation of the displacement that radiation force makes in heated tissue.

Units are SI, except temperature (degC) and thermal dose (min). Nothing here changes a switch of JAX; results are
stated for float64, which a program turns on with `jax.config.update("jax_enable_x64", True)`.
"""

from arfjax.acoustics.intensity import heat_deposition as heat_deposition
from arfjax.acoustics.intensity import intensity as intensity
from arfjax.acoustics.intensity import radiation_force_density as radiation_force_density
from arfjax.acoustics.one_way import AcousticLayer as AcousticLayer
from arfjax.acoustics.one_way import HarmonicField as HarmonicField
from arfjax.acoustics.one_way import MarchSettings as MarchSettings
from arfjax.acoustics.one_way import solve_field as solve_field
from arfjax.errors import ExtrapolationWarning as ExtrapolationWarning
from arfjax.errors import InputError as InputError
from arfjax.experiment import Experiment as Experiment
from arfjax.experiment import explain as explain
from arfjax.experiment import read_experiment as read_experiment
from arfjax.grid import AxisymmetricGrid as AxisymmetricGrid
from arfjax.laws import Constant as Constant
from arfjax.laws import Exponential as Exponential
from arfjax.laws import FractionalZenerLaw as FractionalZenerLaw
from arfjax.laws import Linear as Linear
from arfjax.laws import NormalisedPolynomial as NormalisedPolynomial
from arfjax.laws import Tabulated as Tabulated
from arfjax.laws import TemperatureLaw as TemperatureLaw
from arfjax.laws import ZenerLaw as ZenerLaw
from arfjax.laws import extrapolations as extrapolations
from arfjax.mechanics.complex_modulus import complex_modulus as complex_modulus
from arfjax.mechanics.dynamics import solve_push as solve_push
from arfjax.mechanics.mesh import Mesh as Mesh
from arfjax.mechanics.viscoelastic import ShearModulus as ShearModulus
from arfjax.mechanics.viscoelastic import ViscoelasticField as ViscoelasticField
from arfjax.mechanics.viscoelastic import YoungModulus as YoungModulus
from arfjax.media import AcousticMedium as AcousticMedium
from arfjax.media import FractionalZener as FractionalZener
from arfjax.media import ThermalMedium as ThermalMedium
from arfjax.media import Zener as Zener
from arfjax.model import DoseSize as DoseSize
from arfjax.model import Layer as Layer
from arfjax.model import Lesion as Lesion
from arfjax.model import Model as Model
from arfjax.model import TabulatedSize as TabulatedSize
from arfjax.model import tabulated_size as tabulated_size
from arfjax.protocols.discretisation import DISPLACEMENT_ACCURACY as DISPLACEMENT_ACCURACY
from arfjax.protocols.discretisation import Discretisation as Discretisation
from arfjax.protocols.discretisation import discretise as discretise
from arfjax.protocols.stepwise import Heating as Heating
from arfjax.protocols.stepwise import StepwiseProtocol as StepwiseProtocol
from arfjax.protocols.stepwise import StepwiseResult as StepwiseResult
from arfjax.protocols.stepwise import focal_temperature_at as focal_temperature_at
from arfjax.protocols.stepwise import layered_field as layered_field
from arfjax.protocols.stepwise import range_notes as range_notes
from arfjax.protocols.stepwise import run_stepwise as run_stepwise
from arfjax.protocols.stepwise import simulate_heating as simulate_heating
from arfjax.protocols.stepwise import stepwise_displacement as stepwise_displacement
from arfjax.thermal.bioheat import Phase as Phase
from arfjax.thermal.bioheat import solve_bioheat as solve_bioheat
from arfjax.thermal.dose import LETHAL_DOSE_MINUTES as LETHAL_DOSE_MINUTES
from arfjax.thermal.dose import cumulative_equivalent_minutes as cumulative_equivalent_minutes
from arfjax.thermal.lesion import lesion_size as lesion_size
from arfjax.tissues import Tissue as Tissue
from arfjax.transducer import Drive as Drive
from arfjax.transducer import FocusedBowl as FocusedBowl

__version__ = "0.1.0"
