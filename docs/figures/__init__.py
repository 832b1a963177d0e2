"""Figures of the book, and the tables beside them, from the library's own results: `python -m docs.figures`.

A page's module has `make(save)`, which prints the tables and hands each figure to `save` with a name.
"""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from markergen.presentation.plots import SERIES, dark, inline, log_axis, plot, svg_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

IMAGES = Path(__file__).parents[1] / "images"
SIZE = 5.4, 3.1

Save = Callable[[str, str], None]
"""Takes the name of a figure and its SVG."""


def drawing(draw: Callable[["Axes"], object], size: tuple[float, float] = SIZE) -> str:
    """Return an SVG file of what is drawn on axes, in colors for light and for dark."""
    return _file(plot(draw, "f", "", "", size).markup, size)


def pictures(draw: Callable[["Figure"], object], size: tuple[float, float]) -> str:
    """Return an SVG file of what is drawn on a figure, in the same way."""
    return _file(inline(svg_bytes(draw, size), "f", "", "").markup, size)


def _file(markup: str, size: tuple[float, float]) -> str:
    """Give a drawing for a page a ground of its own and the rest of a file.

    The page's light-dark() is older browsers' unknown; as an image, a drawing follows the setting by a media query.
    """
    style, rest = re.match(r'<svg style="([^"]*)"(.*)', markup, re.DOTALL).groups()
    results = re.findall(r"(--\w+|fill):light-dark\((#\w+),(#\w+)\)", style)
    light, night = (";".join(f"{name}:{pair[k]}" for name, *pair in results) for k in (0, 1))
    head, body = rest.replace(' role="img" aria-label=""', "", 1).split(">", 1)
    width, height = (72 * side for side in size)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
        f' width="{width:g}pt" height="{height:g}pt"{head}>'
        "<style>svg{font-family:system-ui,sans-serif;stroke-linejoin:round;"
        f"{light}}}.ground{{fill:#ffffff}}"
        f"@media(prefers-color-scheme:dark){{svg{{{night}}}.ground{{fill:{dark('#ffffff')}}}}}</style>"
        f'<rect class="ground" width="100%" height="100%"/>{body}\n'
    )


def lines(
    ax: "Axes",
    series: Sequence[tuple[str, Sequence[float], Sequence[float]]],
    labels: tuple[str, str],
    log: str = "xy",
) -> None:
    """Draw series with their names, x and y, and label the axes, of which those named in `log` are logarithmic."""
    for (name, x, y), style in zip(series, SERIES, strict=False):
        ax.plot(x, y, label=name, **(style if len(x) < 20 else {**style, "marker": ""}))
    for which in log:
        log_axis(ax, which)
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)


def table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table in Markdown."""
    print(f"\n{title}\n", f"| {' | '.join(heads)} |", "|" + "---|" * len(heads), sep="\n")
    print(*(f"| {' | '.join(row)} |" for row in rows), sep="\n", flush=True)
