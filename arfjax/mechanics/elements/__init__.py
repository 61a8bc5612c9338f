"""Meshes, weak forms and what passes between grids and elements."""
