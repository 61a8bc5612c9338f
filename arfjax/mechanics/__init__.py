"""Viscoelastic motion under radiation force."""
