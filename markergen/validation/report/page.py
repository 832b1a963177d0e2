"""From plots and pictures to parts of a page: inline SVG, data URIs, and the template."""

import base64
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Draw = Callable[["Axes"], object]

SHEET = "report.html.j2"
INK, MUTED, FAINT = "#1a1a1a", "#5a5a5a", "#cfcfcf"

SIZE = (4.9, 3.9)
"""Width and height in inches of a plot that shares its row with another."""

SERIES: tuple[dict[str, Any], ...] = (
    {"color": "#0b5394", "linestyle": "-", "marker": "o"},
    {"color": "#c55a11", "linestyle": "--", "marker": "s"},
    {"color": "#5b8c2a", "linestyle": "-.", "marker": "^"},
    {"color": "#8e4585", "linestyle": (0, (1, 1.2)), "marker": "D"},
    {"color": "#7a6a00", "linestyle": (0, (4, 1, 1, 1, 1, 1)), "marker": "v"},
    {"color": "#3a8f8f", "linestyle": (0, (7, 2)), "marker": "P"},
)
"""Looks of the lines of a plot: each differs from the others in dashes and marks as well as in color."""

_RC = {
    "svg.fonttype": "none",  # Text stays text: a reader can search it, and a screen reader can read it.
    "svg.hashsalt": "markergen",
    "svg.id": None,
    "text.parse_math": False,
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "lines.linewidth": 1.5,
    "lines.markersize": 4.5,
    "hatch.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 3.2,
    "figure.constrained_layout.use": True,
}

_JPEG_QUALITY = 90
_SMALL_PNG = 60_000
"""Bytes up to which a picture is left as it is; noise makes larger ones of most views, and a report has a dozen."""


@dataclass(frozen=True)
class Plot:
    """A drawing on the page.

    Attributes
    ----------
    svg : str
        Inline SVG; its text is escaped.
    caption : str
        How to read it.
    wide : bool
        Whether it takes a row of its own.
    """

    svg: str
    caption: str
    wide: bool = False


def plot(draw: Draw, name: str, alt: str, caption: str, size: tuple[float, float] = SIZE) -> Plot:
    """Draw on axes of their own and return the plot; the same drawing gives the same bytes.

    Parameters
    ----------
    draw : callable
        Takes matplotlib axes.
    name : str
        Unique in the page: no two drawings may share an id.
    alt : str
        What is to be seen, for whoever cannot see it.
    size : (float, float)
        Width and height in inches of a page on paper.
    """
    import matplotlib
    from matplotlib.figure import Figure

    # Whatever the user's own settings of matplotlib are, the page looks the same; they are as before afterwards.
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_RC)
        figure = Figure(figsize=size)
        draw(figure.add_subplot())
        return Plot(_svg(figure, name, alt), caption, wide=size[0] > SIZE[0])


def data_uri(png: bytes) -> str:
    """PNG bytes as a data URI; pictures full of noise as JPEG, which takes a fifth of the room."""
    import cv2
    import numpy as np

    kind, data = "png", png
    if len(png) > _SMALL_PNG:
        image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
        jpeg = bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])
        if len(jpeg) < len(png):
            kind, data = "jpeg", jpeg
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def fill(values: Mapping[str, Any]) -> bytes:
    """Fill in the template; every value is escaped but for the drawings, which are our own."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("markergen.validation.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    # A lone surrogate, which JSON allows, has no UTF-8.
    return environment.get_template(SHEET).render(values).encode("utf-8", "replace")


def _svg(figure: Any, name: str, alt: str) -> str:
    import io

    from markupsafe import escape

    buffer = io.StringIO()
    figure.savefig(
        buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")), transparent=True
    )
    text = buffer.getvalue()
    # Ids are made from what is drawn, so that equal things in two drawings of one page would share them.
    text = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", text[text.index("<svg") :])
    # Fonts and joins are the page's: a style inside a drawing would hold for all of the page.
    text = re.sub(r"<style.*?</style>|<metadata>.*?</metadata>|font-family: [^;\"]*; ", "", text, flags=re.DOTALL)
    box = re.search(r'viewBox="[^"]*"', text)
    head = f'<svg {box[0] if box else ""} role="img" aria-label="{escape(alt)}">'
    return head + text[text.index(">") + 1 :].rstrip()
