"""Figures of studies as SVG files: the same drawing gives the same bytes."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE: dict[str, Any] = {
    "svg.fonttype": "path",  # A figure looks the same wherever it is put, whatever fonts are there.
    "svg.hashsalt": "markergen",
    "text.parse_math": False,
    "font.size": 9.5,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.linewidth": 0.7,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "lines.markersize": 4.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "legend.handlelength": 3.2,
    "figure.constrained_layout.use": True,
}


def svg_bytes(draw: Callable[["Figure"], object], size: tuple[float, float]) -> bytes:
    """Draw on a new figure of that width and height in inches, and return it as an SVG file.

    Whatever the user's own settings of matplotlib are, the figure looks the same; they are as before afterwards.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        figure = Figure(figsize=size)
        draw(figure)
        buffer = io.BytesIO()
        # No date and no version of the library.
        figure.savefig(buffer, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
    return buffer.getvalue()
