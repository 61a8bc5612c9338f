"""Fits, posteriors and diagnosis on top of arfjax."""

from inverse.diagnosis.diagnose import Diagnosed as Diagnosed
from inverse.diagnosis.diagnose import diagnose as diagnose
