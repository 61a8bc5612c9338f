"""Differentiable simulation of radiation-force displacement in heated tissue."""

__version__ = "0.1.0"
