"""Figures as files: the same drawing gives the same bytes."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from markergen.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS: dict[str, dict[str, None]] = {".svg": {"Date": None, "Creator": None}, ".png": {"Software": None}}
"""Kinds of pictures by suffix, and what to leave out of each: a time, and a version."""


def check_figure(path: Path) -> None:
    """Refuse a picture of a kind that is not drawn.

    Raises
    ------
    InputError
        If the path ends neither in .svg nor in .png.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"a picture {' or '.join(FORMATS)}", str(path), "choose one of these endings")


def figure_bytes(draw: Callable[[], "Figure"], path: Path) -> bytes:
    """Bytes of a figure as the path's ending says, whatever the user's own settings of matplotlib are."""
    from io import BytesIO

    import matplotlib

    check_figure(path)
    suffix = path.suffix.lower()
    buffer = BytesIO()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams["svg.hashsalt"] = "markergen"
        draw().savefig(buffer, format=suffix[1:], dpi=150, metadata=FORMATS[suffix])
    return buffer.getvalue()


def new_figure() -> "Figure":
    """Return an empty figure that no window belongs to."""
    from matplotlib.figure import Figure

    return Figure(figsize=(6.4, 4.8), layout="constrained")
