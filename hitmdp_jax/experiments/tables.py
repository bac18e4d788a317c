"""Tables of text: printed, and written as CSV and as Markdown."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hitmdp_jax.runs.folder import write

SPACE = 2  # between two columns
Rows = Sequence[Sequence[str]]  # the header first


def show(rows: Rows, title: str | None = None) -> None:
    """Print a table. No word of it is cut, even if it is wider than the terminal."""
    header, *rest = rows
    console = Console(markup=False, emoji=False)  # names are what they are
    table = Table(
        title=title, title_justify="left", box=None, padding=(0, SPACE, 0, 0), pad_edge=False
    )
    widest = [
        max(map(len, " ".join(column).split()), default=0) for column in zip(*rows, strict=True)
    ]
    for name, width in zip(header, widest, strict=True):
        table.add_column(name, min_width=width)
    for row in rest:
        table.add_row(*row)
    needed = sum(widest) + SPACE * len(widest)
    console.print(table, width=max(console.width, needed), crop=False)


def save(rows: Rows, folder: Path, name: str) -> None:
    """Write a table as `name.csv` and `name.md`."""
    text = io.StringIO(newline="")
    csv.writer(text).writerows(rows)
    write(folder / f"{name}.csv", text.getvalue())
    write(folder / f"{name}.md", markdown(rows))


def markdown(rows: Rows) -> str:
    """Return a table as Markdown."""
    lines = [" | ".join(row) for row in rows]
    lines.insert(1, " | ".join("---" for _ in rows[0]))
    return "".join(f"| {line} |\n" for line in lines)
