"""Differentiable simulation of radiation-force displacement in heated tissue."""
