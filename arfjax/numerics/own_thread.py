"""A thread of one's own, for what has to be freed where it was made."""

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

_Result = TypeVar("_Result")


class OwnThread:
    """A thread that begins with the first call and lives as long as the program."""

    def __init__(self, name: str) -> None:
        """Begin with none.

        Args:
            name: Of the thread, for debuggers.
        """
        self._name, self._lock = name, threading.Lock()
        self._jobs: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def call(self, function: Callable[[], _Result]) -> _Result:
        """What a function returns or raises, run there after all that was asked before."""
        with self._lock:
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._work, name=self._name, daemon=True)
                self._thread.start()
        outcome: Future[_Result] = Future()

        def job() -> None:
            try:
                outcome.set_result(function())
            except BaseException as error:
                outcome.set_exception(error)

        self._jobs.put(job)
        return outcome.result()

    def later(self, function: Callable[[], object]) -> None:
        """Run there without waiting; it must not raise. From anywhere, a destructor in the midst of `call` too."""
        self._jobs.put(function)

    def _work(self) -> None:
        while True:
            job = self._jobs.get()
            job()
            del job  # and what it holds, while the next is waited for
