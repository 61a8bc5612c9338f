"""The cores that a program may use, and simulations on several of them."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import jax.numpy as jnp

Task = TypeVar("Task")
Result = TypeVar("Result")


def usable_cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def side_by_side(work: Callable[[Task], Result], tasks: Iterable[Task]) -> list[Result]:
    """What `work` makes of each task, in their order, a thread for every core.

    For work that spends its time in compiled programs, which let other threads run; two cores then do 1.4 times as many
    small simulations a second. Not for programs that call back into Python, as sparse solves do.
    """
    doubled = jnp.result_type(float) == jnp.float64

    def as_precise(task: Task) -> Result:
        # In a `with jax.enable_x64(True)` a new thread would be back at single precision.
        with jax.enable_x64(doubled):
            return work(task)

    with ThreadPoolExecutor(usable_cores()) as threads:
        return list(threads.map(as_precise, tasks))
