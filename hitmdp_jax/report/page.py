"""A page of sections: one HTML file that holds everything it needs."""

import base64
import dataclasses
import gzip
import io
import json
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote, unquote

import jinja2
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure
from PIL import Image
from plotly.offline import get_plotlyjs

from hitmdp_jax.errors import UsageError

DRAWING = (  # it can be moved sideways where it is wider than the screen, also by a key
    '<div class="scroll" tabindex="0" role="group" aria-label="{}">'
    '<img class="drawing" alt="{}" src="data:image/svg+xml,{}"></div>'
)
FILM = '<video controls aria-label="{}" src="data:video/mp4;base64,{}"></video>'
DPI = 120  # of what a drawing holds as pixels
SOURCE = re.compile(r' src="data:image/svg\+xml,([^"]*)"')
PNG = re.compile('data:image/png;base64,([^"]*)')
UNSEEN = re.compile("(<!--.*?-->|<metadata>.*?</metadata>|\\s)+", re.DOTALL)  # of a drawing
PLAIN = " /:=;,.()!?+-_"  # what stands in an address as it is, and is no markup
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


def page(
    title: str,
    subtitle: str,
    sections: Mapping[str, Callable[[], Parts]],
    light: bool = False,
) -> str:
    """Return the page [HTML]; a section that cannot be made is left out, and the page says why.

    Args:
      title: of the page.
      subtitle: what stands below it.
      sections: title -> what makes its parts; it raises UsageError if it cannot.
      light: pack all drawings together, as a page of many needs; they are seen by JavaScript only.
    """
    made: list[Section] = []
    left_out: dict[str, list[str]] = {}  # reason -> the sections that it keeps out
    for name, make in sections.items():
        try:
            made.append(Section(name, list(make())))
        except UsageError as reason:
            left_out.setdefault(str(reason), []).append(name)
    drawings: list[str] = []

    def taken(drawing: re.Match[str]) -> str:
        drawings.append(unquote(drawing[1]))
        return ""

    if light:
        for section in made:
            section.parts[:] = [Markup(SOURCE.sub(taken, part)) for part in section.parts]
    return templates.get_template("page.html").render(
        title=title,
        subtitle=subtitle,
        sections=made,
        drawings=packed(json.dumps(drawings)) if drawings else "",
        left_out=left_out,
        plotly=packed(get_plotlyjs()),
    )


def packed(code: str) -> str:
    """Return a script or data as the page holds them: a part of the length, no markup [base64].

    The same code is the same text, so that the same page is the same file.
    """
    return base64.b64encode(gzip.compress(code.encode(), mtime=0)).decode()


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
    svg = PNG.sub(_smaller, UNSEEN.sub(" ", file.getvalue().decode()))
    return Markup(DRAWING).format(title, title, quote(svg, safe=PLAIN))


def _smaller(png: re.Match[str]) -> str:
    """Return a picture within a drawing as WebP, which has the same pixels in fewer bytes."""
    file = io.BytesIO()
    Image.open(io.BytesIO(base64.b64decode(png[1]))).save(file, format="webp", lossless=True)
    return f"data:image/webp;base64,{base64.b64encode(file.getvalue()).decode()}"


def film(write: Callable[[Path], None], name: str) -> Markup:
    """Return a video as a part of the page.

    Args:
      write: writes it to a path; it raises UsageError if it cannot.
      name: what it is called where it cannot be seen.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        write(path)
        encoded = base64.b64encode(path.read_bytes()).decode()
    return Markup(FILM).format(name, encoded)


def clips(write: Callable[[Sequence[Path]], None], captions: Sequence[str]) -> Markup:
    """Return short videos side by side that play together, over and over.

    Args:
      write: writes them to paths, one each; it raises UsageError if it cannot.
      captions: what stands below each.
    """
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{i}.mp4" for i in range(len(captions))]
        write(paths)
        encoded = [base64.b64encode(path.read_bytes()).decode() for path in paths]
    shown = list(zip(captions, encoded, strict=True))
    return Markup(templates.get_template("clips.html").render(clips=shown))


def beside(parts: Iterable[Markup]) -> Markup:
    """Return parts side by side, as many as there is room for."""
    each = Markup("").join(Markup("<div>{}</div>").format(part) for part in parts)
    return Markup('<div class="beside">{}</div>').format(each)


def heading(title: str) -> Markup:
    """Return the text above a figure."""
    return Markup("<h3>{}</h3>").format(title)


def text(sentence: str) -> Markup:
    """Return a paragraph."""
    return Markup("<p>{}</p>").format(sentence)


def preformatted(block: str) -> Markup:
    """Return a block of text as it stands."""
    return Markup('<pre tabindex="0">{}</pre>').format(block)


def table(rows: Sequence[Sequence[str]], name: str) -> Markup:
    """Return a table, its header first; `name` is what it is called where it cannot be seen."""
    return Markup(templates.get_template("table.html").render(rows=rows, name=name))
