"""Plots with matplotlib: the same drawing gives the same bytes, regardless of the user's settings.

Each kind of picture is drawn by a function of its caller: `svg_bytes` for a figure of a study, which looks the same
everywhere; `plot` for a drawing inside a page, whose text remains text; `figure_bytes` for a file named by the user.
Their axes share `log_axis`, `positive` and `legend_below`; `SERIES` are the line styles.
"""

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markergen.errors import InputError, brief

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

INK, MUTED, FAINT = "#1a1a1a", "#5a5a5a", "#cfcfcf"

COLORS = "YlOrBr"
"""Colormap that is monotonic in lightness, so that it keeps its order in grayscale."""

SERIES: tuple[dict[str, Any], ...] = (
    {"color": "#0b5394", "linestyle": "-", "marker": "o"},
    {"color": "#c55a11", "linestyle": "--", "marker": "s"},
    {"color": "#5b8c2a", "linestyle": "-.", "marker": "^"},
    {"color": "#8e4585", "linestyle": (0, (1, 1.2)), "marker": "D"},
    {"color": "#7a6a00", "linestyle": (0, (4, 1, 1, 1, 1, 1)), "marker": "v"},
    {"color": "#3a8f8f", "linestyle": (0, (7, 2)), "marker": "P"},
)
"""Styles of the lines of a plot, which differ in dashes and markers as well as in color."""

FORMATS: dict[str, dict[str, None]] = {".svg": {"Date": None, "Creator": None}, ".png": {"Software": None}}
"""Picture formats by suffix, and the metadata to omit from each: the date and the version of matplotlib."""

SIZE = (4.9, 3.3)
"""Width and height in inches of a plot that shares its row of a page with another."""

_SALT = {"svg.hashsalt": "markergen"}
"""Seed for the ids in an SVG file, which matplotlib otherwise draws at random."""

_STYLE: dict[str, Any] = {
    **_SALT,
    "svg.fonttype": "path",  # A figure looks the same whatever fonts are installed.
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

_PAGE_STYLE: dict[str, Any] = {
    **_STYLE,
    "svg.fonttype": "none",  # Text remains text, which can be searched and read by screen readers.
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "hatch.linewidth": 0.7,
}

# From linear sRGB to cone responses, and from their cube roots to Oklab (Ottosson 2020).
_LMS = (
    (0.4122214708, 0.5363325363, 0.0514459929),
    (0.2119034982, 0.6806995451, 0.1073969566),
    (0.0883024619, 0.2817188376, 0.6299787005),
)
_OKLAB = (
    (0.2104542553, 0.7936177850, -0.0040720468),
    (1.9779984951, -2.4285922050, 0.4505937099),
    (0.0259040371, 0.7827717662, -0.8086757660),
)
"""Lightness and two axes of chroma."""

_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))

_TICKS = (
    (3, (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9)),
    (12, (1, 2, 3, 5, 7)),
    (60, (1, 2, 5)),
    (1000, (1, 3)),
    (math.inf, (1,)),
)
"""Labeled steps in each decade of a logarithmic axis, by the ratio of its limits."""


@dataclass(frozen=True)
class Plot:
    """Drawing on a page.

    Attributes
    ----------
    markup : str
        Inline SVG or another element, with escaped text.
    caption : str
        Explanation below the drawing.
    kind : str
        Names from the page's style: ``wide``; ``paper`` for an object that is white in the dark as well; ``still`` and
        ``live`` for two of which scripts show the other; ``view`` for a photograph.
    title : str
        Beginning of the caption.
    """

    markup: str
    caption: str
    kind: str = ""
    title: str = ""


def plot(
    draw: Callable[["Axes"], object],
    name: str,
    alt: str,
    caption: str,
    size: tuple[float, float] = SIZE,
    kind: str = "",
    **labels: str,
) -> Plot:
    """Draw on new axes, and return the drawing as part of a page, in colors for light and for dark.

    Parameters
    ----------
    draw : callable
        Function that draws on the given matplotlib axes.
    name : str
        Prefix of the drawing's ids, unique in the page.
    alt : str
        Text alternative for readers who cannot see the drawing.
    size : (float, float)
        Width and height in inches when printed.
    kind : str
        See `Plot`.
    **labels : str
        ``xlabel`` and ``ylabel`` of the axes, where `draw` leaves them out.
    """
    from matplotlib.figure import Figure

    with _settings(_PAGE_STYLE):
        figure = Figure(figsize=size)
        ax = figure.add_subplot()
        draw(ax)
        ax.set(**labels)
        svg = _saved(figure, format="svg", metadata=_NO_METADATA, transparent=True)
    return inline(svg, name, alt, caption, kind or ("wide" if size[0] > SIZE[0] else ""))


def inline(svg: bytes, name: str, alt: str, caption: str, kind: str = "") -> Plot:
    """Return a drawing made by `svg_bytes` as part of a page; parameters as for `plot`."""
    text = _inline(svg.decode(), name, alt)
    if "paper" not in kind and "<image" in text:
        # Pixels keep their colors.
        kind = f"{kind} paper".strip()
    return Plot(text if "paper" in kind else _recolored(text), caption, kind)


def dark(color: str) -> str:
    """Return what a color of a light page becomes on a dark one: lightness is inverted, hue and chroma are kept.

    The lightness L of Oklab becomes 0.2 + 0.76 (1 - L)^0.7, so that white paper becomes nearly black and black ink
    nearly white, with more contrast between dark tones than a straight line leaves. Colors that no screen can show lose
    chroma until one can.

    Parameters
    ----------
    color : str
        Six hexadecimal digits after ``#``.

    Examples
    --------
    >>> dark("#ffffff"), dark("#000000")
    ('#161616', '#f2f2f2')
    """
    import numpy as np

    srgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    lightness, *chroma = _OKLAB @ np.cbrt(_LMS @ linear)
    for share in np.linspace(1, 0, 21):
        lms = np.linalg.solve(_OKLAB, [0.2 + 0.76 * max(1 - lightness, 0.0) ** 0.7, *(share * np.array(chroma))]) ** 3
        linear = np.linalg.solve(_LMS, lms)
        if np.all((linear > -1e-4) & (linear < 1 + 1e-4)):
            break
    linear = np.clip(linear, 0, 1)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in srgb.tolist())


def color_steps(name: str) -> "Colormap":
    """Return a colormap in few enough steps that its bar is drawn as rectangles, which have colors for the dark too."""
    import matplotlib

    return matplotlib.colormaps[name].resampled(40)


def svg_bytes(draw: Callable[["Figure"], object], size: tuple[float, float]) -> bytes:
    """Draw on a new figure of the given width and height in inches, and return it as an SVG file."""
    from matplotlib.figure import Figure

    with _settings(_STYLE):
        figure = Figure(figsize=size)
        draw(figure)
        return _saved(figure, format="svg", metadata=_NO_METADATA)


def figure_bytes(draw: Callable[[], "Figure"], path: Path) -> bytes:
    """Return the figure made by `draw` as a file in the format of the path's suffix."""
    check_figure(path)
    suffix = path.suffix.lower()
    with _settings(_SALT):
        return _saved(draw(), format=suffix[1:], dpi=150, metadata=FORMATS[suffix])


def check_figure(path: Path) -> None:
    """Reject the name of a picture in an unsupported format.

    Raises
    ------
    InputError
        If the path ends neither in .svg nor in .png.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"a picture {' or '.join(FORMATS)}", brief(str(path)), "choose one of these endings")


def new_figure(size: tuple[float, float] = (6.4, 4.8)) -> "Figure":
    """Return an empty figure of `size` in inches without a window."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, layout="constrained")


def axes_of(ax: object, size: tuple[float, float] = (6.4, 4.8)) -> "Axes":
    """Return the given axes, or for None those of a new figure of `size` in inches, which notebooks show.

    Raises
    ------
    InputError
        If `ax` is something else, such as a figure or the array of axes from ``plt.subplots(2)``.
    """
    from matplotlib.axes import Axes

    if ax is None:
        figure = new_figure(size)
        ax = figure.add_subplot()
        # As for pyplot's figures, a cell's last line is its picture.
        ax._repr_png_ = partial(_saved, figure, format="png", dpi=110)  # type: ignore[attr-defined]
        return ax
    if not isinstance(ax, Axes):
        raise InputError("axes of matplotlib", f"ax={brief(ax)}", "give axes from plt.subplots, or None")
    return ax


def positive(value: float | None) -> float:
    """Return a value if a logarithmic axis can show it, otherwise nan, which leaves a gap."""
    return float(value) if value and value > 0 and math.isfinite(value) else float("nan")


def ticks(low: float, high: float) -> tuple[float, ...]:
    """Return the steps within a decade at which a logarithmic scale from low to high is labeled."""
    return next(steps for ratio, steps in _TICKS if high < ratio * low or ratio == math.inf)


def log_axis(ax: "Axes", which: str, steps: tuple[float, ...] = ()) -> None:
    """Make the ``x`` or ``y`` axis logarithmic, with plain numbers at the given steps of each decade, or at `ticks`."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    getattr(ax, f"set_{which}scale")("log")
    axis = getattr(ax, f"{which}axis")
    axis.set_major_locator(LogLocator(subs=steps or ticks(*getattr(ax, f"get_{which}lim")()), numticks=40))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def legend_below(ax: "Axes") -> None:
    """Put the legend below the axes, where it covers no line."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2, columnspacing=1.2)


@contextmanager
def _settings(style: Mapping[str, Any]) -> Iterator[None]:
    """Apply these matplotlib settings on top of its defaults, and restore the user's afterwards."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(style)
        yield


def _saved(figure: "Figure", **options: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, **options)
    return buffer.getvalue()


def _inline(svg: str, name: str, alt: str) -> str:
    from markupsafe import escape

    # Ids are hashes of what they identify, so equal items in two drawings of one page would share an id.
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg[svg.index("<svg") :])
    # The page sets fonts and joins: a style inside a drawing would apply to the entire page.
    svg = re.sub(r"<style.*?</style>|<metadata>.*?</metadata>|font-family: [^;\"]*; ", "", svg, flags=re.DOTALL)
    box = re.search(r'viewBox="[^"]*"', svg)
    head = f'<svg {box[0] if box else ""} role="img" aria-label="{escape(alt)}">'
    # A hundredth of a point is finer than any screen or printer.
    short = re.sub(
        r' (?:d|x|y)="[^"]*"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match[0]), svg[svg.index(">") + 1 :]
    )
    return head + short.rstrip()


def _recolored(svg: str) -> str:
    """Replace colors by names that stand for one color in the light and another in the dark."""
    pattern = r'((?:fill|stroke): |(?:fill|stroke)=")(#[0-9a-f]{6})'
    used = dict.fromkeys(match[1] for match in re.findall(pattern, svg))
    names = "".join(f"--{color[1:]}:light-dark({color},{dark(color)});" for color in used)
    # What is black is not written.
    names += f"fill:light-dark(#000000,{dark('#000000')})"
    svg = re.sub(pattern, lambda match: f"{match[1]}var(--{match[2][1:]})", svg)
    return svg.replace("<svg ", f'<svg style="{names}" ', 1)
