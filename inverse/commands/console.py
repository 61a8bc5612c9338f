"""What a command shows in the terminal: tables on the output stream, progress on the error stream."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text


def show_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> None:
    """Print a table, whole however narrow the terminal; the first `left` columns are words, the others numbers."""
    table = Table(title=title, title_justify="left", header_style="bold")
    for index, column in enumerate(columns):
        table.add_column(Text(column), no_wrap=True, justify="left" if index < left else "right")
    for row in rows:
        table.add_row(*map(Text, row))
    wide = Console(width=1000)
    Console(width=max(Console().width, wide.measure(table).maximum)).print(table)


def show_lines(lines: Sequence[str], *, style: str = "") -> None:
    """Print lines as they are."""
    console = Console()
    for line in lines:
        console.print(line, style=style, markup=False, highlight=False, soft_wrap=True)


@contextlib.contextmanager
def progress_bar(total: int) -> Iterator[Callable[[str], None]]:
    """A bar of `total` steps, gone when done; call the function with a description as each step begins."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("starting", total=total)
        begun = False

        def step(description: str) -> None:
            nonlocal begun
            progress.update(task, description=description, advance=1 if begun else 0)
            begun = True

        yield step
        progress.update(task, completed=total)


@contextlib.contextmanager
def working(description: str) -> Iterator[Callable[[str], None]]:
    """A sign of life on the error stream for work whose steps cannot be counted, gone when done.

    Call the function with another description as the work goes on.
    """
    with Console(stderr=True).status(description) as status:
        yield status.update
