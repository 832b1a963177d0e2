"""Figures as files: the same drawing gives the same bytes."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from markergen.errors import InputError, brief

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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


def new_figure(size: tuple[float, float] = (6.4, 4.8)) -> "Figure":
    """Return an empty figure that no window belongs to."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


def axes_of(ax: object, size: tuple[float, float] = (6.4, 4.8)) -> "Axes":
    """Axes that were given, or, for None, those of a new figure of `size` in inches.

    Raises
    ------
    InputError
        If it is something else, such as a figure, or the array of axes that ``plt.subplots(2)`` makes.
    """
    from matplotlib.axes import Axes

    if ax is None:
        return new_figure(size).add_subplot()
    if not isinstance(ax, Axes):
        raise InputError("axes of matplotlib", f"ax={brief(ax)}", "give one of those that plt.subplots makes, or None")
    return ax
