"""What a command shows in the terminal: tables on the output stream, progress on the error stream."""

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
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


@contextlib.contextmanager
def staged_bar(description: str, stages: Mapping[str, float]) -> Iterator[Callable[[str], None]]:
    """A bar of work that goes through known stages, gone when done; it never goes back.

    Call the function with what is being done: words that begin with a stage's name, and end with "3 of 12" where the
    stage is counted. A stage that is left out is passed by; other words are shown, and the bar stays.

    Args:
        description: Of the work, before it begins.
        stages: About how long each takes, by its first words, in their order.
    """
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(description, total=sum(stages.values()))

        def show(words: str) -> None:
            done = max(done_of(words, stages), progress.tasks[task].completed)
            progress.update(task, description=words, completed=done)

        yield show


def done_of(words: str, stages: Mapping[str, float]) -> float:
    """How much of the stages is done, 0 where the words are of none; see `staged_bar`."""
    before = 0.0
    for name, share in stages.items():
        if words.startswith(name):
            counted = re.search(r"(\d+) of (\d+)$", words)
            return before + (share * int(counted[1]) / max(int(counted[2]), 1) if counted else 0.0)
        before += share
    return 0.0
