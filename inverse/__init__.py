"""Fits, posteriors and diagnosis on top of arfjax."""
