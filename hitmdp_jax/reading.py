"""Reading files that may be damaged or a stranger's: what is wrong is a sentence with its line."""

import csv
import errno
import io
import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import yaml

from hitmdp_jax.errors import UsageError

DEEPEST = 20  # lists and mappings within each other; settings have four
KINDS = ("str", "int", "float", "bool", "null", "seq", "map")  # of what YAML may hold here
PLAIN = {f"tag:yaml.org,2002:{kind}" for kind in KINDS}


def unreadable(path: Path, why: str, line: int | None = None) -> UsageError:
    """Return the error of a file that cannot be read, in a line that counts from 1."""
    place = "" if line is None else f"line {line}: "
    return UsageError(f"'{path}' cannot be read: {place}{why}.")


def refuse_endless(path: Path) -> None:
    """Raise OSError where reading might never end: a pipe waits for whoever writes into it."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "it is a pipe or a device", str(path))


def check_tree(folder: Path) -> None:
    """Check a folder before a library, which would wait at a pipe, reads all of it.

    Raises:
      UsageError: there is a pipe or a device in it, or a link to a folder, whose files may be both.
    """
    for above, folders, files in os.walk(folder):
        for path in (Path(above, name) for name in folders + files):
            if path.is_symlink() and path.is_dir():
                raise unreadable(path, "it is a link to a folder")
            try:
                refuse_endless(path)
            except OSError as error:
                raise unreadable(path, str(error.strerror)) from None


def read_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
      OSError: it cannot be read, or is a pipe or a device.
    """
    refuse_endless(path)
    return path.read_bytes()


def read_text(path: Path) -> str:
    """Return a file's text.

    Raises:
      UsageError: it cannot be read, or is not UTF-8.
    """
    try:
        content = read_bytes(path)
    except OSError as error:
        raise unreadable(path, error.strerror or type(error).__name__) from None
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise unreadable(path, "it is not text in UTF-8", line) from None


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file: words, numbers, true, false, null, lists and mappings.

    A date is a word. What makes a small file endless (aliases, deep nesting) is refused, and so are
    words with control characters, which would reach a terminal.

    Raises:
      UsageError: the file holds something else, or cannot be read.
    """
    return parse_yaml(read_text(path), path)


def parse_yaml(text: str, path: Path) -> Any:
    """Return the value of a file's YAML text; Raises as `read_yaml`."""
    try:
        return yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise unreadable(path, str(error.problem), mark and mark.line + 1) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise unreadable(path, "it holds a control character", line) from None


class _Loader(yaml.SafeLoader):
    """Builds nothing but words, numbers, lists and mappings, and nothing twice."""

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node, unless it is an alias or too deep."""
        mark = self.peek_event().start_mark
        if self.check_event(yaml.AliasEvent):
            raise yaml.MarkedYAMLError(problem="an alias stands for something", problem_mark=mark)
        if self.depth == DEEPEST:
            problem = f"more than {DEEPEST} lists and mappings lie within each other"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Return the value of a node; errors name the place in the file."""
        mark = node.start_mark
        if node.tag not in PLAIN:
            problem = f"the tag '{node.tag}' stands for something that no setting is"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
        try:
            value = super().construct_object(node, deep)
        except (ValueError, OverflowError) as error:  # a number of too many digits
            raise yaml.MarkedYAMLError(problem=str(error), problem_mark=mark) from None
        if isinstance(value, str) and not value.rstrip("\n").isprintable():
            problem = "a word holds a control character"
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
        return value


_Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in resolvers if tag in PLAIN]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def read_numbers(
    path: Path,
    needed: Iterable[str] = (),
    unfinished: bool = False,
    words: Collection[str] = (),
) -> list[dict[str, Any]]:
    """Return the rows of a table of numbers by column name; an empty cell is NaN.

    Args:
      path: as `read_rows`.
      needed: as `read_rows`.
      unfinished: as `read_rows`.
      words: columns that hold words instead.

    Raises:
      UsageError: as `read_rows`, or a cell is no number.
    """
    rows: list[dict[str, Any]] = []
    for number, cells in read_rows(path, needed, unfinished):
        row: dict[str, Any] = {}
        for name, cell in cells.items():
            try:
                row[name] = cell if name in words else float(cell or "nan")
            except ValueError:
                raise unreadable(path, f"{name} = {cell} is not a number", number) from None
        rows.append(row)
    return rows


def read_rows(
    path: Path, needed: Iterable[str] = (), unfinished: bool = False
) -> list[tuple[int, dict[str, str]]]:
    """Return the rows of a table, each with its line's number and its cells by column name.

    Args:
      path: a CSV file, its columns' names in the first line; no cell has a line's end in it.
      needed: columns that a table with rows must have.
      unfinished: whether it is written line by line: a last line without its end is left out.

    Raises:
      UsageError: the file cannot be read, or a row has not one cell a column.
    """
    lines = io.StringIO(read_text(path)).readlines()  # which no other separator ends
    if lines and not lines[-1].endswith("\n"):
        if not unfinished:
            raise unreadable(path, "it ends in the middle", len(lines))
        lines.pop()
    header, *rows = [_cells(path, *line) for line in enumerate(lines, start=1)] or [[]]
    if len(set(header)) < len(header):
        raise unreadable(path, "two columns have one name", 1)
    if rows and (missing := [name for name in needed if name not in header]):
        raise unreadable(path, f"no column is called '{missing[0]}'", 1)
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise unreadable(path, f"it has {len(row)} cells, not {len(header)}", number)
    return [(n, dict(zip(header, row, strict=True))) for n, row in enumerate(rows, start=2)]


def _cells(path: Path, number: int, line: str) -> list[str]:
    """Return a line's cells; lines are read one by one, so that a quote cannot swallow others."""
    try:
        return next(csv.reader([line.rstrip("\r\n")], strict=True), [])
    except csv.Error as error:
        raise unreadable(path, str(error), number) from None
