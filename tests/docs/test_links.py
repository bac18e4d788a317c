"""What the manual's pages point at is there: pages, headings, pictures, files."""

import fnmatch
import re
from pathlib import Path

import pytest

from hitmdp_jax.runs import folder
from tests.docs.pages import BLOCK, ROOT, pages, spans
from tests.docs.test_extending import FILES

PAGES = pages()
# Files are named by the end of their paths; or they are what runs write.
PARTS = ("benchmarks", "configs", "docs", "examples", "hitmdp_jax", "results", "tests")
KNOWN = {f"/{path.relative_to(ROOT)}" for part in PARTS for path in (ROOT / part).rglob("*.*")}
KNOWN |= {f"/{path.name}" for path in ROOT.glob("*.*")}
WRITTEN = (*folder.FILES, f"{folder.FIGURES}/*", f"{folder.SWEEP}.*", "metrics.jsonl")
OTHERS = {"optimization_results.yaml"}  # which Optuna's sweeper writes
SOURCE = re.compile(r"[\w./-]+\.(?:py|yaml|md|csv|html|png|ipynb)")


def anchors(path):
    """Return the anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", BLOCK.sub("", path.read_text()), re.MULTILINE)
    words = (re.sub(r"[^\w -]", "", heading).lower() for heading in headings)
    return {word.replace(" ", "-") for word in words}


@pytest.mark.parametrize("name", PAGES)
def test_every_link_leads_somewhere(name):
    page = ROOT / name
    for link in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", PAGES[name])):
        if link.startswith("http"):
            continue
        path, _, anchor = link.partition("#")
        target = page.parent / path if path else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("name", PAGES)
def test_every_file_that_is_named_exists(name):
    own = {file.rpartition("/")[2] for file in FILES}
    for span in spans(PAGES[name]):
        if not SOURCE.fullmatch(span) or span in OTHERS | own:
            continue
        path = span.removeprefix("RUN_DIR/")
        written = any(fnmatch.fnmatch(path, pattern) for pattern in WRITTEN)
        assert written or any(known.endswith(f"/{path}") for known in KNOWN), span
        assert not Path(path).is_absolute()
