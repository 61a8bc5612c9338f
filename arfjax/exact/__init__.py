"""Closed-form solutions that the solvers are tested against."""
