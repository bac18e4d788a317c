"""Something that moves on a terminal while a command works."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def working(text: str) -> Iterator[None]:
    """Show what is being done and for how long, until it is done; nothing if nobody watches.

    It is shown on standard error, so that what a command prints can be piped on.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield
        return
    columns = SpinnerColumn(), TextColumn(text), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as shown:
        shown.add_task("")
        yield
