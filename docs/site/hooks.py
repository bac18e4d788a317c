"""What MkDocs does beyond its own: pages from outside docs/, and the reference from docstrings.

The pages of this repository link to one another, and to files, by relative paths, so that they work
where the repository is shown. On the site everything lies below docs/, so links that lead out of it
are led to copies of what they mean.
"""

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from formulas import drawn  # a file beside this one, which MkDocs lets a hook import
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
PAGES = {  # of the site -> in the repository
    "index.md": "README.md",
    "notebook.md": "results/notebook.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
REFERENCE = ("agents", "envs", "physics", "learning", "networks", "training", "interpret", "theory")
PUBLIC = "hitmdp_jax"
LINK = re.compile(r"(\]\()(?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?(\))")
CODE = re.compile(r"(^ *```.*?^ *```|`[^`\n]+`)", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and files from outside docs/, and the reference."""
    for uri, source in PAGES.items():
        files.append(File.generated(config, uri, content=(ROOT / source).read_text()))
    for name, text in _reference():
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    written = {**{f"docs/{x.name}": x for x in (ROOT / "docs").glob("*.md")}}
    written |= {source: ROOT / source for source in PAGES.values()}
    targets = {
        target
        for source, path in written.items()
        for target in _targets(path.read_text(), source)
        if _uri(target).startswith("files/")
    }
    for target in sorted(targets):
        files.append(_copied(target, config))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Draw the formulas, and lead each relative link to where its target lies on the site."""
    uri = page.file.src_uri
    if uri.startswith(("reference/", "files/")):
        return markdown
    source = PAGES.get(uri, f"docs/{uri}")

    def moved(link: re.Match) -> str:
        target = _uri(posixpath.normpath(posixpath.join(posixpath.dirname(source), link[2])))
        there = posixpath.relpath(target, posixpath.dirname(uri) or ".")
        return f"{link[1]}{there}{link[3] or ''}{link[4]}"

    parts = CODE.split(drawn(markdown))  # every second one is code
    return "".join(part if i % 2 else LINK.sub(moved, part) for i, part in enumerate(parts))


def _targets(text: str, source: str) -> Iterator[str]:
    """Yield the paths in the repository that a page's relative links mean."""
    for link in LINK.findall(CODE.sub("", text)):
        yield posixpath.normpath(posixpath.join(posixpath.dirname(source), link[1]))


def _uri(target: str) -> str:
    """Return where a file of the repository lies on the site."""
    pages = {source: uri for uri, source in PAGES.items()}
    if target in pages:
        return pages[target]
    if target.startswith("docs/"):
        return target.removeprefix("docs/")
    return f"files/{target}.md" if (ROOT / target).is_dir() else f"files/{target}"


def _copied(target: str, config: MkDocsConfig) -> File:
    """Return a file of the repository as one of the site; a folder becomes one page."""
    path = ROOT / target
    if not path.is_dir():
        return File.generated(config, _uri(target), abs_src_path=str(path))
    parts = [f"# {target}\n"]
    for file in sorted(x for x in path.rglob("*") if x.suffix in (".yaml", ".py")):
        code = f"```{file.suffix[1:]}\n{file.read_text()}```"
        parts.append(f"## {file.relative_to(path)}\n\n{code}\n")
    return File.generated(config, _uri(target), content="\n".join(parts))


def _reference() -> Iterator[tuple[str, str]]:
    """Yield each page of the reference, its name and its Markdown."""
    exported = re.search(r"__all__ = \[(.*?)\]", (ROOT / PUBLIC / "__init__.py").read_text(), re.S)
    assert exported is not None
    names = re.findall(r'"(\w+)"', exported[1])
    shown = [f"::: {PUBLIC}.{x}" for x in names if x not in ("agents", "__version__")]
    yield "index", "\n\n".join([f"# {PUBLIC}\n\nThe names that the package itself offers.", *shown])
    for folder in REFERENCE:
        modules = sorted((ROOT / PUBLIC / folder).rglob("*.py"))
        dotted = [".".join(x.relative_to(ROOT).with_suffix("").parts) for x in modules]
        shown = [f"::: {name}" for name in dotted if not name.endswith("__init__")]
        yield folder, "\n\n".join([f"# {PUBLIC}.{folder}", *shown])
