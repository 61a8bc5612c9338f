"""The entry point: sets what a program may set and a library may not, runs a command, and words its errors."""

import os
import signal
import sys
from typing import Any

_STOPPED = 130  # what shells give for Ctrl-C, and what typer may return instead of raising


def main() -> None:
    """Run `arfjax`; a user's mistake is answered in one line on the error stream and exit status 2."""
    # Before numpy is loaded: BLAS threads slow the many small factorisations down, many times on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # A scheduler's request to stop cleans up as Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command line and return its exit status."""
    import jax
    import typer

    from inverse.cores import usable_cores

    jax.config.update("jax_enable_x64", True)
    if usable_cores() == 1:
        # A sparse solve calls back into Python, where its numbers may have to wait for a thread of XLA's. On one core
        # there is one, which the solve itself holds, unless programs run in the thread that asked for them.
        jax.config.update("jax_cpu_enable_async_dispatch", False)
    from arfjax import InputError
    from inverse.commands.app import app
    from inverse.commands.partial import StoppedEarly

    if "" in arguments:
        place = arguments.index("")
        of = arguments[place - 1] if place and arguments[place - 1].startswith("-") else f"argument {place + 1}"
        return _complain(f"{of}: the value is empty; give one (is a shell variable not set?).")
    # Found through a class that typer exports, because some of its versions bring their own copy of click.
    usage_error: Any = typer.BadParameter.__mro__[1]
    try:
        status = app(arguments or ["--help"], standalone_mode=False)
    except InputError as error:
        return _complain(str(error))
    except usage_error as error:
        message = error.format_message().replace("Value error, ", "")
        return _complain(f"{message} (`arfjax --help` lists commands and options)")
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _complain(f"{place}{error.strerror or error}; nothing was written.")
    except StoppedEarly as stop:
        sys.stderr.write(f"arfjax: stopped; {stop}\n")
        return _STOPPED
    except (KeyboardInterrupt, typer.Abort):
        status = _STOPPED
    if status == _STOPPED:
        sys.stderr.write("arfjax: stopped; nothing was written.\n")
    return status if isinstance(status, int) else 0


def _complain(message: str) -> int:
    sys.stderr.write(f"arfjax: {' '.join(message.split())}\n")
    return 2
