"""A page of sections: one HTML file that holds everything it needs."""

import base64
import dataclasses
import io
from collections.abc import Callable, Iterator, Mapping, Sequence

import jinja2
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure
from plotly.offline import get_plotlyjs

from hitmdp_jax.errors import UsageError

DPI = 150  # of what a drawing holds as pixels
Parts = Iterator[Markup]
templates = jinja2.Environment(
    loader=jinja2.PackageLoader("hitmdp_jax.report"),
    autoescape=True,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the page: a question and what answers it."""

    title: str
    parts: list[Markup]

    @property
    def anchor(self) -> str:
        """What a link to it names."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower()).strip("-")


def page(title: str, subtitle: str, sections: Mapping[str, Callable[[], Parts]]) -> str:
    """Return the page [HTML]; a section that cannot be made is left out, and the page says why.

    Args:
      title: of the page.
      subtitle: what stands below it.
      sections: title -> what makes its parts; it raises UsageError if it cannot.
    """
    made: list[Section] = []
    left_out: dict[str, list[str]] = {}  # reason -> the sections that it keeps out
    for name, make in sections.items():
        try:
            made.append(Section(name, list(make())))
        except UsageError as reason:
            left_out.setdefault(str(reason), []).append(name)
    return templates.get_template("page.html").render(
        title=title,
        subtitle=subtitle,
        sections=made,
        left_out=left_out,
        plotly=Markup(get_plotlyjs()),
    )


def drawing(figure: Figure, title: str) -> Markup:
    """Return a figure as a part of the page.

    It is a picture of its own, in which no name of a stranger is markup of the page.

    Args:
      figure: what is shown.
      title: what it is called where it cannot be seen.
    """
    file = io.BytesIO()
    with rc_context({"svg.hashsalt": "hitmdp_jax"}):  # the same figure is the same file
        figure.savefig(file, format="svg", dpi=DPI, metadata={"Date": None})
    encoded = base64.b64encode(file.getvalue()).decode()
    source = Markup('<img class="drawing" alt="{}" src="data:image/svg+xml;base64,{}">')
    return source.format(title, encoded)


def heading(title: str) -> Markup:
    """Return the text above a figure."""
    return Markup("<h3>{}</h3>").format(title)


def text(sentence: str) -> Markup:
    """Return a paragraph."""
    return Markup("<p>{}</p>").format(sentence)


def preformatted(block: str) -> Markup:
    """Return a block of text as it stands."""
    return Markup("<pre>{}</pre>").format(block)


def table(rows: Sequence[Sequence[str]]) -> Markup:
    """Return a table, its header first."""
    return Markup(templates.get_template("table.html").render(rows=rows))
