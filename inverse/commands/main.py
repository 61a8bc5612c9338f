"""The entry point: sets what a program may set and a library may not, runs a command, and words its errors."""

import os
import sys


def main() -> None:
    """Run `arfjax`; a user's mistake is answered in one line on the error stream and exit status 2."""
    # Before numpy is loaded: BLAS threads slow the many small factorisations down, many times on a busy machine.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run a command line and return its exit status."""
    import click
    import jax

    jax.config.update("jax_enable_x64", True)
    from arfjax import InputError
    from inverse.commands.app import app

    try:
        app(arguments, standalone_mode=False)
    except InputError as error:
        return _complain(str(error))
    except click.ClickException as error:
        return _complain(f"{error.format_message()} (`arfjax --help` lists commands and options)")
    except (KeyboardInterrupt, click.Abort):
        sys.stderr.write("arfjax: stopped; nothing was written.\n")
        return 130
    return 0


def _complain(message: str) -> int:
    sys.stderr.write(f"arfjax: {' '.join(message.split())}\n")
    return 2
