"""Several cores: results in the order of the tasks, and errors of any of them."""

import os
import threading

import jax
import jax.numpy as jnp
import pytest

from inverse import cores


def test_cores_are_those_that_the_process_may_use():
    assert 1 <= cores.usable_cores() <= (os.cpu_count() or 1)


def test_work_goes_on_side_by_side_and_comes_back_in_order(monkeypatch):
    monkeypatch.setattr(cores, "usable_cores", lambda: 3)
    met = threading.Barrier(3, timeout=30.0)  # broken unless three tasks run at a time

    def work(task: int) -> int:
        met.wait()
        return task**2

    assert cores.side_by_side(work, range(6)) == [0, 1, 4, 9, 16, 25]


def test_an_error_of_one_task_is_raised():
    with pytest.raises(ZeroDivisionError):
        cores.side_by_side(lambda task: 1 // task, [2, 1, 0])


@pytest.mark.parametrize(("doubled", "kind"), [(True, "float64"), (False, "float32")])
def test_precision_is_that_of_the_thread_that_asks(doubled, kind):
    with jax.enable_x64(doubled):
        assert cores.side_by_side(lambda task: jnp.asarray(0.1 * task).dtype.name, range(4)) == [kind] * 4


def test_program_that_is_compiled_already_serves_all_threads():
    traced = []
    program = jax.jit(lambda number: traced.append(number) or 2.0 * number)
    assert program(1.0) == 2.0
    assert cores.side_by_side(lambda task: float(program(float(task))), range(4)) == [0.0, 2.0, 4.0, 6.0]
    assert len(traced) == 1
