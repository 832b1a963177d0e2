"""Views of a fabrication drawing that stand among its tables: sections, the back, and the key to fills and hatches."""
# tests: tests/workshop/drafting/test_rig_drawing.py tests/workshop/drafting/test_views.py

from collections.abc import Sequence
from dataclasses import dataclass

from markergen.drawing.scene import Box, Shape, bounds, frame_lines, overlaps
from markergen.drawing.text import text_width
from markergen.geometry.contour import Contour
from markergen.workshop.drafting.drawing import Dimension, EngravedText, SectionView, ViewFace, Workpiece, around
from markergen.workshop.drafting.pen import (
    CLOSE,
    LETTERS,
    DrawingView,
    Lettering,
    Style,
    across,
    beside,
    center_line,
    cut_edges,
    drawn,
    lettering,
    scale_words,
    vertical_dimension,
)

SCALES = (10, 5, 2, 1, 1 / 2, 1 / 5, 1 / 10, 1 / 20, 1 / 50, 1 / 100, 1 / 200)
"""Available scales (ISO 5455)."""


@dataclass(frozen=True)
class DetailView:
    """Separate view to place among tables and notes.

    Attributes
    ----------
    title : str
        Subject and scale of the view.
    width, height : float
        Size, mm on paper.
    shapes : tuple of Shape
        Shapes, mm from the lower left corner; text is `Lettering`.
    """

    title: str
    width: float
    height: float
    shapes: tuple[Shape, ...]


def section_view(section: SectionView, width: float, height: float, style: Style) -> DetailView:
    """Draw a section of the solid at the largest scale that suits a column of the given width and height, mm."""
    left, bottom, right, top = section.box
    tier = CLOSE * style.scale
    below = 0.8 * tier
    low = max(min(min((face.box[1] for face in section.faces), default=bottom), top), bottom)

    def lift(scale: float) -> float:
        # Text beside short dimensions must not collide with that of the heights.
        narrow = any(
            text_width(span.text, style.words) > scale * (span.end - span.start) - style.head for span in section.across
        )
        return 1.5 * tier if narrow else 0.6 * tier

    def reach(scale: float) -> float:
        heights = stacked_at(section.upright, scale, 0.9 * tier, tier, style)
        wide = scale * (right - left)
        # Words beside a short dimension start at its right end, or beyond its outer arrows.
        extents = [
            scale * (span.end - left) + 3 * style.head + text_width(span.text, style.words)
            for span in section.across
            if text_width(span.text, style.words) > scale * (span.end - span.start) - style.head
        ]
        return max([wide + (heights[-1][1] if heights else 0.0), *extents]) + 0.6 * tier

    def fits(scale: float, room: float) -> bool:
        tall = scale * (top - low) + lift(scale) + len(section.across) * tier + below
        return reach(scale) <= width and tall <= room

    # Small if that shows enough; more room if the section would be smaller than the solid.
    rooms = min(0.45 * height, 52 * style.scale), 0.7 * height
    scales = [next((candidate for candidate in SCALES[1:] if fits(candidate, room)), SCALES[-1]) for room in rooms]
    scale = scales[0] if scales[0] >= 1 else min(scales[1], 1.0)
    above = max(lift(scale) + len(section.across) * tier, 1.5 * tier)
    deep = scale * (top - low) + above + below
    view = DrawingView(0.3 * tier - scale * left, below - scale * low, scale)
    shapes: list[Shape] = []
    for face in section.faces:
        shapes += drawn(face, view, True, style)
    for face in section.faces:
        shapes += cut_edges(face, view, section.box)
    for axis in section.axes:
        (x, foot), (_, head) = view.at((axis, low)), view.at((axis, top))
        over = 2 * style.scale
        shapes += center_line((x, foot - over), (x, head + over), style)
    # Outer dimensions first, so that the text of the inner ones covers their extension lines.
    for number, span in reversed(list(enumerate(section.across))):
        line = view.at((0.0, top))[1] + lift(scale) + number * tier
        starts = [view.at((0.0, _highest(section.faces, at, top)))[1] for at in (span.start, span.end)]
        x0, x1 = (view.at((at, 0.0))[0] for at in (span.start, span.end))
        shapes += across(x0, x1, line, (starts[0], starts[1]), span.text, style)
    edge = view.at((right, 0.0))[0]
    shapes += stacked(section.upright, view, edge, edge + 0.9 * tier, tier, style)
    return DetailView(f"{section.title}, {scale_words(scale)}", width, deep, tuple(shapes))


def back_view(work: Workpiece, width: float, height: float) -> DetailView:
    """Draw the back at the largest scale that suits a column of the given width and height, mm."""
    left, bottom, right, top = around(work.back)
    # The title needs the rest of the height.
    room = min(0.92 * height, width)
    # Half a millimeter on each side for line widths.
    scale = next((s for s in SCALES if s * (right - left) + 1 <= width and s * (top - bottom) <= room), SCALES[-1])
    view = DrawingView(0.5 - scale * left, 0.5 - scale * bottom, scale)
    shapes = [shape for face in work.back for shape in drawn(face, view)]
    # Text that would be smaller than what is legible is drawn larger.
    is_small = any(text.height * scale < LETTERS - 1e-9 for text in work.engraved)
    remark = ", letters larger than to scale" if is_small else ""
    taken: list[Box] = []
    # The title first: an id that has no room is in the note about the engraving.
    for text in sorted(work.engraved, key=lambda engraving: -len(engraving.lines[0])):
        lines = _back_text(text, view)
        boxes = [bounds(line) for line in lines]
        if not any(overlaps(box, other) for box in boxes for other in taken):
            shapes += lines
            taken += boxes
    title = f"Seen from the back, {scale_words(scale)}{remark}"
    return DetailView(title, width, scale * (top - bottom) + 1, tuple(shapes))


def back_crowded(work: Workpiece, width: float, height: float) -> bool:
    """True if letters on the back that are drawn larger than to scale overlap in a view of that size."""
    view = back_view(work, width, height)
    drawn_ = sum(isinstance(shape, Lettering) for shape in view.shapes)
    return drawn_ < sum(len(text.lines) for text in work.engraved)


def key_view(work: Workpiece, width: float, style: Style) -> DetailView:
    """Draw what fills and hatches mean."""
    wide, high, step = 12 * style.scale, 4 * style.scale, max(6.5 * style.scale, 2 * style.small)
    height = step * len(work.key)
    shapes: list[Shape] = []
    for number, (kind, meaning) in enumerate(work.key):
        low = height - (number + 1) * step + (step - high) / 2
        corners = (0.5, low), (wide, low), (wide, low + high), (0.5, low + high)
        material = kind.removeprefix("cut-")
        face = ViewFace((Contour(corners),), material)
        shapes += drawn(face, DrawingView(0.0, 0.0, 1.0), kind != material, style)
        shapes.append(frame_lines((0.5, low, wide, low + high), 0.2))
        base = low + (high - style.small) / 2
        shapes.append(lettering(meaning, wide + 2.5 * style.scale, base, style.small))
    return DetailView("Key", width, height, tuple(shapes))


def stacked_at(
    spans: Sequence[Dimension], scale: float, first: float, tier: float, style: Style
) -> list[tuple[float, float]]:
    """Places of dimensions along z beside each other: distance of each line, and of the far side of its words."""
    spots: list[tuple[float, float]] = []
    before = 0.0
    for span in spans:
        half = beside(span.text, scale * (span.end - span.start), style)
        at = max(first, half + 0.3 * tier) if not spots else spots[-1][0] + max(tier, before + half + 1.6 * style.scale)
        spots.append((at, at + half))
        before = half
    return spots


def stacked(
    spans: Sequence[Dimension], view: DrawingView, start: float, first: float, tier: float, style: Style
) -> list[Shape]:
    """Dimensions along z in the given order, each one farther to the right.

    An extension line that words of an inner dimension cover begins beyond them: what is left of it before looks like a
    minus.
    """
    drawn: list[list[Shape]] = []
    texts: list[Box] = []
    for span, (at, _) in zip(spans, stacked_at(spans, view.scale, first - start, tier, style), strict=True):
        low, high = (view.at((0.0, z))[1] for z in (span.start, span.end))
        from_low, from_high = (max([start, *(box[2] for box in texts if box[1] < y < box[3])]) for y in (low, high))
        drawn.append(vertical_dimension(low, high, start + at, (from_low, from_high), span.text, style))
        texts += [bounds(shape) for shape in drawn[-1] if isinstance(shape, Lettering)]
    # Outer dimensions first, so that the text of the inner ones covers their lines.
    return [shape for shapes in reversed(drawn) for shape in shapes]


def _back_text(text: EngravedText, view: DrawingView) -> list[Shape]:
    """Engraved text as drawing text, in the face and at the place of the letters but not smaller than legible."""
    left, bottom, right, top = view.box(text.box)
    height = max(text.height * view.scale, LETTERS)
    x, y = (left + right) / 2, (bottom + top) / 2
    tall = height * (1 + 1.6 * (len(text.lines) - 1))
    return [
        lettering(line, x, y + tall / 2 - height - number * 1.6 * height, height, "center", face="bold", name="back")
        for number, line in enumerate(text.lines)
    ]


def _highest(faces: Sequence[ViewFace], at: float, top: float) -> float:
    """Start of the extension line at a position along the cut: the highest corner of the edge there."""
    heights = [z for face in faces for ring in face.contours for s, z in ring.points if abs(s - at) < 1e-3]
    return max(heights, default=top)
