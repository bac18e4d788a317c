"""Formulas of the site: TeX becomes MathML, which browsers draw by themselves, when it is built.

Docstrings hold formulas in blocks of `.. math::`, and pages in blocks of the language "math". So
nothing is fetched from other servers to draw them, and no script runs.
"""

import re
import textwrap
from typing import Any

import griffe
from latex2mathml.converter import convert

IN_DOCSTRING = re.compile(r"^\.\. math::\n((?:[ \t]+\S.*(?:\n|\Z))+)", re.MULTILINE)
IN_PAGE = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)


class Formulas(griffe.Extension):
    """Draws the formulas of docstrings; mkdocs.yml names this class."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Replace the formulas of an object's docstring."""
        if obj.docstring is not None:
            obj.docstring.value = IN_DOCSTRING.sub(_drawn, obj.docstring.value)


def drawn(markdown: str) -> str:
    """Return a page whose formulas are MathML."""
    return IN_PAGE.sub(_drawn, markdown)


def _drawn(formula: re.Match) -> str:
    tex = " ".join(textwrap.dedent(formula[1]).split("\n"))
    if "&" in tex and r"\begin" not in tex:
        tex = rf"\begin{{split}} {tex} \end{{split}}"
    return f'<div class="formula">{convert(tex, display="block")}</div>\n'
