"""Tables of text: printed, and written as CSV and as Markdown."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from hitmdp_jax.runs.folder import write

Rows = Sequence[Sequence[str]]  # the header first


def show(rows: Rows) -> None:
    """Print a table."""
    header, *rest = rows
    printed = Table(*header)
    for row in rest:
        printed.add_row(*row)
    Console(markup=False, emoji=False).print(printed)  # names are what they are


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
