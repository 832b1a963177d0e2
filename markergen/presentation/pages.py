"""HTML pages that load nothing; all text is escaped. One template serves the reports and the pages of studies."""

import base64
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from markergen import __version__
from markergen.arrays import Array
from markergen.errors import InputError
from markergen.presentation.plots import Plot, dark
from markergen.presentation.tables import Table

BOOK = "https://github.com/markergen/markergen/blob/main/docs/"
"""Address of the documentation, to which pages link; the same as in pyproject.toml."""

_JPEG_QUALITY = 90
"""Quality of the views of a report, which are to be looked at, not measured."""
_SMALL_PNG = 60_000
"""Maximum size in bytes of a picture kept as PNG; noise makes most views larger, and a report has a dozen of them."""
_RING = 72
"""Least number of points of an outline from which some are left out in a dome."""
_START = """
for (const each of document.querySelectorAll("[data-dome]")) {
  document.documentElement.classList.add("scripted");
  dome(each, JSON.parse(each.dataset.dome));
}
"""


@dataclass
class Section:
    """Content of a section of a page, in the order in which it is shown; what is empty is left out.

    Attributes
    ----------
    sentences, warnings : list of str
    plots : list of Plot
    tables : list of Table
    missing : str
        How to obtain absent results.
    terms : list of (str, str)
        Terms and what they mean.
    text : str
        Shown as it is, such as a command to copy.
    parts, folded : list of (str, Section)
        Under headings of their own; folded ones are to be unfolded, and not printed.
    files : list of str
        Names of files beside the page.
    book : (str, str) or None
        Words, and the page and heading of the documentation to which they lead, such as ``validate.md#views``.
    """

    sentences: list[str] = field(default_factory=list)
    plots: list[Plot] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    missing: str = ""
    warnings: list[str] = field(default_factory=list)
    terms: list[tuple[str, str]] = field(default_factory=list)
    text: str = ""
    parts: list[tuple[str, "Section"]] = field(default_factory=list)
    folded: list[tuple[str, "Section"]] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    book: tuple[str, str] | None = None


def page(
    heading: str,
    title: str,
    sections: Sequence[tuple[str, str, Section | None]],
    subject: str,
    note: str,
    aside: Plot | None = None,
    open_sections: int | None = None,
) -> bytes:
    """Make a page in UTF-8 that loads nothing; equal content gives equal bytes.

    It is readable in light and dark, on a phone and on paper. Its only script is `dome.js`, if a plot needs it.

    Parameters
    ----------
    heading : str
        Heading, which also begins the title of the window.
    title, subject, note : str
        What the page is about: for the window, below the heading, and at the end.
    sections : sequence of (str, str, Section or None)
        Id, heading and content of each; None leaves it out. The first sentence of the first is the largest.
    aside : Plot or None
        Picture beside the heading.
    open_sections : int or None
        Number of sections that are shown; the others are to be unfolded, but on paper. None shows all.

    Examples
    --------
    >>> b"<p>a&lt;b</p>" in page("Report", "", [("answer", "Answer", Section(["a<b"]))], "", "")
    True
    """
    from jinja2 import Environment, StrictUndefined

    present = [section for section in sections if section[2] is not None]
    live = any("live" in plot.kind for _, _, section in present if section for plot in section.plots)
    script = _file("dome.js") + _START if live else ""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    html = environment.from_string(_file("page.html.j2")).render(
        heading=heading,
        title=title,
        subject=subject,
        note=note,
        sections=present,
        aside=aside,
        open_sections=len(present) if open_sections is None else open_sections,
        version=__version__,
        book=BOOK,
        dark=dark,
        script=script,
        script_hash="sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )
    # JSON allows lone surrogates, which UTF-8 cannot encode.
    return html.strip().encode("utf-8", "replace") + b"\n"


def picture(title: str, caption: str, png: bytes, box: tuple[int, int, int, int] | None = None) -> Plot:
    """Return a photograph or rendered view, or the part of it in a box, as part of a page."""
    import cv2
    from markupsafe import escape

    if box:
        left, upper, right, lower = box
        image = np.asarray(cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_UNCHANGED))
        png = bytes(cv2.imencode(".png", image[upper:lower, left:right])[1])

    return Plot(f'<img src="{data_uri(png)}" alt="{escape(f"{title}. {caption}")}">', caption, "view", title)


def dome_figure(
    centers: Array,
    errors: Mapping[str, Array],
    outlines: Sequence[Array],
    dots: Sequence[Mapping[str, Any]],
    caption: str,
    remarks: Sequence[str] = (),
) -> Plot:
    """Return the dome of poses, to turn and to pick from; plots of the kind ``still`` beside it replace it on paper.

    Parameters
    ----------
    centers : array (P, 3), m
        Camera centers in the frame of the marker or rig.
    errors : mapping of str to array (P,)
        RMS ``rotation``, deg, and ``translation``, mm; unknown or unbounded where it is not finite.
    outlines, dots : sequences
        What the cameras look at, in the form described in dome.js.
    remarks : sequence of str
        More about each pose.
    """
    from jinja2.utils import htmlsafe_json_dumps

    parts = {**dict(zip("xyz", centers.T, strict=True)), **errors}
    poses: dict[str, Any] = {
        name: [float(f"{value:.4g}") if math.isfinite(value) else None for value in values.tolist()]
        for name, values in parts.items()
    }
    rings = [ring[:: max(1, len(ring) // _RING)].round(5).tolist() for ring in outlines]
    data = {"poses": poses | ({"words": remarks} if remarks else {}), "room": {"outlines": rings}, "dots": dots}
    return Plot(f"<div data-dome='{htmlsafe_json_dumps(data)}'></div>", caption, "live wide")


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text("utf-8")


def data_uri(png: bytes) -> str:
    """Return PNG bytes as a data URI; noisy pictures become JPEG, a fifth of the size."""
    import cv2

    kind, data = "png", png
    if len(png) > _SMALL_PNG:
        image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
        jpeg = bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])
        if len(jpeg) < len(png):
            kind, data = "jpeg", jpeg
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def check_page(path: Path) -> None:
    """Reject a file name whose suffix is not that of an HTML page.

    Raises
    ------
    InputError
        If the path ends neither in .html nor in .htm.
    """
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError("a page .html", str(path), "name the report so that a browser opens it")
