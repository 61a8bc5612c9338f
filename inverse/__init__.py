"""Fits, posteriors and diagnosis on top of arfjax."""

from inverse.diagnosed import Diagnosed as Diagnosed
from inverse.diagnosed import diagnose as diagnose
