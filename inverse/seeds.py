"""Seeds that every generator of random numbers here takes."""

HIGHEST_SEED = 2**32 - 1
"""Of NumPy's older generators, which emcee draws from; JAX and newer ones take more."""
