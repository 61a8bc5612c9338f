"""Every test runs in float64, with strict promotion of ranks, and without changing JAX's switches for the others."""

import gc
import os
from pathlib import Path

# One thread each for BLAS and LAPACK: more slow the small factorisations down many times on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import matplotlib
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
matplotlib.use("Agg")

_SWITCHES = ("jax_enable_x64", "jax_numpy_rank_promotion", "jax_debug_nans")


@pytest.fixture(autouse=True)
def _global_switches_are_left_alone():
    before = {name: getattr(jax.config, name) for name in _SWITCHES}
    yield
    assert {name: getattr(jax.config, name) for name in _SWITCHES} == before


@pytest.fixture(scope="module", autouse=True)
def few_compiled_programs():
    """Drop compiled programs before their memory maps run out: with 65 530 of them XLA crashes (Linux only)."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 30_000:
        jax.clear_caches()
        gc.collect()
