"""The manual's pages as text, and what is read out of them."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^ *```(\w*)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
COMMAND = r"(?:python train\.py|python -m hitmdp_jax|hitmdp)(?: .*)?$"


def pages() -> dict[str, str]:
    """Return every page that is written by hand, by its path from the root."""
    paths = [
        ROOT / "README.md",
        ROOT / "results/notebook.md",
        *sorted((ROOT / "docs").glob("*.md")),
    ]
    texts = {str(path.relative_to(ROOT)): path.read_text() for path in paths}
    # Its commands come from the settings of the runs that it tells of (`cli.command_line`).
    del texts["docs/results.md"]
    return texts


def spans(page: str) -> list[str]:
    """Return what stands between backticks in a page's prose, each on one line."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", BLOCK.sub("", page))]


def commands(page: str) -> Iterator[str]:
    """Yield the package's commands in a page, of its blocks and of its prose."""
    for language, block in BLOCK.findall(page):
        if language == "bash":
            for line in block.replace("\\\n", " ").splitlines():
                yield from re.findall(COMMAND, line)
    for span in spans(page):
        for part in span.split("; "):
            yield from re.findall(f"^{COMMAND}", part)
