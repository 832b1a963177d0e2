"""The page: a scene on paper, and the sheet that holds one marker whole.

+--------------------------+
|       |  ticks on axes   |   everything but the dots keeps out of their quiet zones: a ring half a dot
|     o   o                |   diameter wide around each, which detectors need white
| _                        |
| |  -o + o-   boundary    |
| |                        |
| L_|_|_|_| rulers   axes  |
| lengths to measure       |
|  ----------------------  |
|  marker  dots  size ...  |
+--------------------------+
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markergen.drawing import checks, furniture, rulers
from markergen.drawing.colors import Colors
from markergen.drawing.face import GROUND, LAYERS, draw_face
from markergen.drawing.figure import Figure, is_disk, size_words
from markergen.drawing.furniture import TICK, Frame
from markergen.drawing.options import SheetOptions
from markergen.drawing.paper import Paper
from markergen.drawing.scene import Box, Disk, Layer, Point, Scene, Shape, around_origin
from markergen.drawing.transform import shifted
from markergen.model.marker import Marker, marker_name

MOST_LISTED = 12
"""Of the dots that a note names."""

_AWAY = "The marker's origin is not on the sheet; see the coordinates in marker.json."


@dataclass(frozen=True)
class Sheet:
    """A page ready for any printable format.

    Attributes
    ----------
    paper : Paper
    scene : Scene
        In mm from the page's lower left corner; layers ``dots``, ``tag`` if there is one, ``cut``, ``marks`` and
        ``text``, below them ``ground`` if the paper's color is printed.
    origins_mm : tuple of (x, y)
        Where the markers' origins are on the page, one per marker; a tile's may be beyond its edge, a plan has none.
    rulers_mm : (int, int)
        What the printed rulers along x and y measure; 0 without one.
    title, description : str
        For the file's metadata.
    notes : tuple of str
        Sentences for the user; those about several pages come with the first.
    trim_mm : (left, bottom, right, top)
        What is left of the page once it is cut: all of it but for tiles.
    """

    paper: Paper
    scene: Scene
    origins_mm: tuple[Point, ...]
    rulers_mm: tuple[int, int]
    title: str
    description: str
    notes: tuple[str, ...]
    trim_mm: Box

    @property
    def origin_mm(self) -> Point:
        """Where the first marker's origin is."""
        return self.origins_mm[0]

    @property
    def ruler_mm(self) -> int:
        """Length of the ruler along x."""
        return self.rulers_mm[0]


@dataclass(frozen=True)
class Reach:
    """How far the outline and the quiet zones reach from the origin: left, down, right, up; mm."""

    outline: Box
    quiet: Box
    grounded: bool = False
    """Whether the ground is printed, which then has to stay between the margins."""


def reach_of(outline: Box, quiet: Box, colors: Colors) -> Reach:
    """How far a marker reaches with an outline and quiet zones in these boxes (mm, marker frame)."""
    sides = [(-box[0], -box[1], box[2], box[3]) for box in (outline, quiet)]
    return Reach(sides[0], sides[1], colors.grounded)


def needs(frame: Frame, reach: Reach) -> Box:
    """Distances in mm that the origin must keep from the paper's left, lower, right and upper edge.

    Marks and a printed ground keep to the margin; blank quiet zones may fill it, but not leave the paper.
    """
    ink, quiet = (tuple(side + TICK * frame.scale for side in reach.outline)), reach.quiet
    if reach.grounded:
        ink = tuple(max(pair) + GROUND * frame.scale for pair in zip(reach.outline, quiet, strict=True))
    left, down, right, up = ink
    return (
        max(frame.margin + left, quiet[0]),
        frame.footer + max(down, quiet[1]),
        max(frame.margin + right, quiet[2]),
        max(frame.margin + up, quiet[3]),
    )


def origin_on(frame: Frame, reach: Reach) -> Point | None:
    """Where the origin goes: centered across the paper if it can, in the middle of the room above the footer.

    None if the marker does not fit.
    """
    left, down, right, up = needs(frame, reach)
    paper = frame.paper
    if left + right > paper.width or down + up > paper.height:
        return None
    aside = (reach.outline[2] - reach.outline[0]) / 2
    x = min(max(paper.width / 2 - aside, left), paper.width - right)
    return x, (down + paper.height - up) / 2


def scene_of(layers: Sequence[Mapping[str, Sequence[Shape]]]) -> Scene:
    """Scene of what several drawings have in each layer; layers ``ground`` and ``tag`` only if they hold something."""
    found = {name: tuple(shape for each in layers for shape in each.get(name, ())) for name in LAYERS}
    return Scene(tuple(Layer(name, found[name]) for name in LAYERS if found[name] or name not in ("ground", "tag")))


def moved_layers(layers: Mapping[str, Sequence[Shape]], dx: float, dy: float) -> dict[str, tuple[Shape, ...]]:
    """All shapes moved by (dx, dy) mm."""
    return {name: tuple(shifted(shape, dx, dy) for shape in shapes) for name, shapes in layers.items()}


def footer(
    frame: Frame, markers: Sequence[Marker], factor: Point, taken: Mapping[str, Sequence[Shape]], where: str = ""
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """What stands below and beside markers, and the lengths of the rulers.

    Rulers, axes, lengths to measure, what to do if they are off, and the title block.
    """
    scale, left, base = frame.scale, frame.margin, frame.ruler_y
    axes_marks, axes_text = furniture.axes(frame)
    room = frame.width - 24 * scale
    x_length = next((length for length in rulers.LENGTHS if length * factor[0] <= room), rulers.LENGTHS[-1])
    x_marks, x_text = rulers.ruler((left, base), x_length, 0, scale, factor[0])
    band = rulers.BAND * scale
    others = [shape for name, shapes in taken.items() if name != "dots" for shape in shapes]
    dots = [shape for shape in taken["dots"] if isinstance(shape, Disk)]
    y_length, (y_marks, y_text) = rulers.placed(
        [
            ((left, base - furniture.FINE / 2, left + band, frame.top), 1),
            ((frame.right - band, frame.footer, frame.right, frame.top), -1),
        ],
        1,
        scale,
        factor[1],
        dots,
        others,
        "ruler-y",
    )
    lengths = (x_length, y_length)
    words = furniture.remedy(frame, checks.remedy(lengths), frame.block_top + 7.6 * scale, 1.6 * scale)
    lines = furniture.facts(frame, checks.columns(markers[0], lengths, where), frame.checks_y, "check")
    block_marks, block_text = furniture.title_block(frame, markers, factor)
    layers: dict[str, tuple[Shape, ...]] = {
        "marks": (*x_marks, *y_marks, *axes_marks, *block_marks),
        "text": (*x_text, *y_text, *axes_text, *lines, *words, *block_text),
    }
    return layers, lengths


def single(figure: Figure, options: SheetOptions, frame: Frame, origin: Point) -> Sheet:
    """Sheet of one marker on one page."""
    x, y = origin
    left, bottom, right, top = frame.region
    room = left - x, bottom - y, right - x, top - y
    face = draw_face(figure, options.colors, frame.scale, room)
    placed = moved_layers(face.layers, x, y)
    below, lengths = footer(frame, [figure.marker], figure.factor, placed)
    size = size_words(figure.marker.boundary)
    paper = frame.paper
    return Sheet(
        paper,
        scene_of([placed, below]),
        (origin,),
        lengths,
        marker_name(figure.marker),
        f"Fiducial marker with {len(figure.marker)} dots, {size}, at true size on {paper}. Print at 100 %.",
        _notes(figure, f"{'stands on' if options.paper else 'needs'} {paper}", lengths, face.nameless)
        + (() if around_origin(room) else (_AWAY,)),
        (0.0, 0.0, paper.width, paper.height),
    )


def _notes(figure: Figure, where: str, lengths: tuple[int, int], nameless: Sequence[str]) -> tuple[str, ...]:
    boundary = figure.marker.boundary
    shape = "disk" if is_disk(boundary) else "outline"
    return (
        f"The marker {where}: its {shape} is {size_words(boundary)}.",
        f"Print at 100 %, then check that the rulers on the sheet measure {checks.ruler_words(lengths)}.",
        *compensated_note(figure),
        *nameless_note(nameless),
    )


def compensated_note(figure: Figure) -> tuple[str, ...]:
    """A sentence about a drawing that is true from one printer only."""
    if figure.factor == (1.0, 1.0):
        return ()
    factors = " and ".join(f"{value:.6g} along {name}" for name, value in zip("xy", figure.factor, strict=True))
    return (
        f"Everything is drawn {factors} times as large, for the printer that was measured: from it the marker comes "
        "out as designed, so use it with the marker.json that was not rescaled.",
    )


def nameless_note(nameless: Sequence[str]) -> tuple[str, ...]:
    """A sentence about dots that have no room for their number."""
    if not nameless:
        return ()
    more = len(nameless) - MOST_LISTED
    listed = ", ".join(nameless[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
    which = f"Dot {listed} has" if len(nameless) == 1 else f"Dots {listed} have"
    return (f"{which} no room for a number outside the quiet zones; see the coordinates in marker.json.",)
