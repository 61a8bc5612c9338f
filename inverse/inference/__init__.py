"""Inference: parameters, priors and noise of a model, fits, posteriors, and what the data can and cannot tell."""
