"""Several cores: results in the order of the tasks, and errors of any of them."""

import os
import threading

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
