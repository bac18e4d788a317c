"""mkdocs.yml: every page has a place on the site. What builds it is the extra `docs`."""

import re

import pytest

from tests.docs.pages import ROOT

SETTINGS = (ROOT / "mkdocs.yml").read_text()
NAVIGATION = set(re.findall(r"([\w/]+\.md)$", SETTINGS.split("\nnav:\n")[1], re.MULTILINE))


def test_every_page_of_the_manual_is_in_the_navigation():
    written = {path.name for path in (ROOT / "docs").glob("*.md")}
    assert len(written) > 15
    assert written <= NAVIGATION


def test_the_navigation_names_no_page_that_is_not_there():
    (made,) = re.findall(r"^PAGES = \{.*?\n(.*?)^\}", hooks(), re.MULTILINE | re.DOTALL)
    others = dict(re.findall(r'"([\w.]+)": "([\w./]+)"', made))
    assert all((ROOT / source).is_file() for source in others.values())
    for page in NAVIGATION - {path.name for path in (ROOT / "docs").glob("*.md")} - {*others}:
        folder = page.removeprefix("reference/").removesuffix(".md")
        assert folder == "index" or (ROOT / "hitmdp_jax" / folder).is_dir(), page


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path, monkeypatch):
    """By hand, after `pip install -e '.[docs]'`: what it installs is fetched slowly by some."""
    build = pytest.importorskip("mkdocs.commands.build")
    config = pytest.importorskip("mkdocs.config")
    monkeypatch.chdir(ROOT)
    site = config.load_config(str(ROOT / "mkdocs.yml"), site_dir=str(tmp_path), strict=True)
    build.build(site)
    for page in ("reference/theory", "reference/agents", "theory"):
        text = (tmp_path / page / "index.html").read_text()
        assert '<math xmlns="http' in text
        assert "math::" not in text
        assert "```math" not in text


def hooks():
    return (ROOT / "docs" / "site" / "hooks.py").read_text()
