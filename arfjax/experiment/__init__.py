"""The experiment file: a TOML file that says what was sonicated, with what and how."""

from arfjax.experiment.file import Experiment as Experiment
from arfjax.experiment.file import read_experiment as read_experiment
from arfjax.experiment.messages import explain as explain
