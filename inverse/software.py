"""Which software made a result."""

import platform

import jax

import arfjax


def versions() -> dict[str, str]:
    """Versions of this package, JAX and Python."""
    return {"arfjax": arfjax.__version__, "jax": jax.__version__, "python": platform.python_version()}
