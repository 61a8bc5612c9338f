"""Independent pieces of a study done one after the other, or by several processes at once."""

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from multiprocessing import get_context
from typing import Any

import jax
import numpy as np

_AHEAD = 2
"""Pieces handed to each worker before it has done the first: none waits for the next, and few are lost at the end."""


def spread(
    work: Callable[..., Any], todo: Sequence[tuple], *, workers: int = 1, minutes: float = np.inf
) -> Iterator[Any]:
    """Results as they come.

    Args:
        work: Does one piece; a function of a module, so that other processes find it.
        todo: Its arguments, for every piece.
        workers: Processes; each compiles for itself. One does the work here.
        minutes: After so long no piece is handed out; those that workers have are still done.
    """
    end = time.perf_counter() + 60.0 * minutes
    rest = iter(todo)

    def following() -> tuple | None:
        return None if time.perf_counter() > end else next(rest, None)

    if workers == 1:
        while (one := following()) is not None:
            yield work(*one)
        return
    # Spawned: a fork of a process in which JAX has run hangs.
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_float64) as pool:
        pending: set[Future] = set()
        while True:
            while len(pending) < _AHEAD * workers and (one := following()) is not None:
                pending.add(pool.submit(work, *one))
            if not pending:
                return
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            yield from (piece.result() for piece in done)


def _float64() -> None:
    jax.config.update("jax_enable_x64", True)
