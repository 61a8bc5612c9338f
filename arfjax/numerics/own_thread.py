"""A thread of one's own, for what has to be freed where it was made."""

import logging
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

_LOGGER = logging.getLogger(__name__)
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
        try:
            return outcome.result()
        finally:
            # An error knows the frames that it went through, and these know the outcome that it is in.
            del outcome

    def later(self, function: Callable[[], object]) -> None:
        """Run there without waiting; errors are logged. From anywhere, a destructor in the midst of `call` too."""
        self._jobs.put(function)

    def finish(self) -> None:
        """Wait until all is done that was asked before; if nothing ever was, none begins."""
        if self._thread is not None and self._thread.is_alive():
            self.call(lambda: None)

    def _work(self) -> None:
        while True:
            job = self._jobs.get()
            try:
                job()
            except Exception:
                _LOGGER.exception("what was asked of the thread %s failed", self._name)
            del job  # and what it holds, while the next is waited for
