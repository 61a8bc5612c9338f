"""Pieces of a study by one process or several: the same results."""

import operator
import time

from benchmarks.spread import spread

PIECES = [(number, 10) for number in range(5)]


def test_one_process_and_two_do_the_same():
    assert list(spread(operator.mul, PIECES)) == [0, 10, 20, 30, 40]
    assert sorted(spread(operator.mul, PIECES, workers=2)) == [0, 10, 20, 30, 40]


def test_nothing_is_begun_when_time_is_over():
    begun = spread(time.sleep, [(0.05,)] * 100, minutes=0.1 / 60.0)
    assert 1 <= len(list(begun)) <= 3
    assert list(spread(operator.mul, PIECES, minutes=0.0)) == []
