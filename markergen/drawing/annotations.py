"""Annotations around markers on a sheet: axis arrows, columns of facts, paragraphs and the title block."""
# tests: tests/drawing/test_paper_net.py tests/drawing/test_print_measurements.py

from collections.abc import Sequence

import markergen
from markergen.drawing.figure import dot_sizes, is_disk, size_words
from markergen.drawing.paper import Frame
from markergen.drawing.scene import BLACK, FINE, GRAY, HAIRLINE, LIGHT, Line, Point, Shape, polygon
from markergen.drawing.text import text, text_width, wrap
from markergen.model.marker import Marker, marker_name

Drawn = tuple[list[Shape], list[Shape]]
"""Marks and texts."""

Column = tuple[str, str, tuple[str, ...], str]
"""Slug, heading, lines and face of a column of facts."""

MOST_LISTED = 12
"""Maximum number of dots named in a note."""

MOST_IDS = 6
"""Maximum number of ids that the title block lists one by one."""


def axis_arrows(frame: Frame) -> Drawn:
    """Two labeled arrows that show the directions of the marker frame's x and y axes."""
    scale = frame.scale
    length, x, y = 9 * scale, frame.right - 12 * scale, frame.ruler_y
    head, half = 2.2 * scale, 0.7 * scale
    tip_x, tip_y = x + length, y + length
    marks: list[Shape] = [
        Line(((x, y), (tip_x - head, y)), FINE, "axes-x"),
        Line(((x, y - FINE / 2), (x, tip_y - head)), FINE, "axes-y"),
        polygon([(tip_x, y), (tip_x - head, y + half), (tip_x - head, y - half)], "axes-x-head", BLACK),
        polygon([(x, tip_y), (x - half, tip_y - head), (x + half, tip_y - head)], "axes-y-head", BLACK),
    ]
    texts: list[Shape] = [
        text("x", frame.right, y - 0.8 * scale, 1.9 * scale, "right", name="axes-x-label"),
        text("y", x, tip_y + 1.5 * scale, 1.9 * scale, "center", name="axes-y-label"),
    ]
    return marks, texts


def title_block(
    frame: Frame, markers: Sequence[Marker], factor: Point = (1.0, 1.0), page: tuple[int, int] = (1, 1)
) -> Drawn:
    """Title block at the foot of the sheet: small gray headings above their values, from margin to margin."""
    first = markers[0]
    same = all(marker.boundary == first.boundary and dot_sizes(marker) == dot_sizes(first) for marker in markers)
    meaning = "size: diameter of the outline" if is_disk(first.boundary) else "size: width x height of the outline"
    name = marker_name(first).removeprefix("markergen-")
    if any(marker_name(marker) != marker_name(first) for marker in markers):
        name = "see captions"
    columns: list[Column] = [("spec", "spec", (name,), "bold")]
    if len(markers) > 1:
        columns.append(("markers", "markers", (str(len(markers)),), "regular"))
    columns += tag_column(markers)
    columns.append(("dots", "dots", (" + ".join(dict.fromkeys(str(len(marker)) for marker in markers)),), "regular"))
    if same:
        columns += [
            ("dot-diameter", "dot diameter", (dot_sizes(first),), "regular"),
            ("size", meaning, (size_words(first.boundary),), "regular"),
        ]
    columns.append(scale_column(factor))
    if page[1] > 1:
        columns.append(("page", "page", (f"{page[0]} of {page[1]}",), "regular"))
    columns.append(("made-with", "made with", (f"markergen {markergen.__version__}",), "regular"))
    rule = Line(((frame.margin, frame.block_top), (frame.right, frame.block_top)), HAIRLINE, "rule", LIGHT)
    return [rule], facts(frame, columns, frame.margin, "block")


def tag_column(markers: Sequence[Marker]) -> list[Column]:
    """Column with the tags of markers and the side of their black square; none if there are no tags of one kind."""
    tags = [marker.tag for marker in markers if marker.tag]
    if len(tags) < len(markers) or len({(tag.family, tag.side) for tag in tags}) > 1:
        return []
    ids = [tag.id for tag in tags]
    consecutive = len(ids) > 1 and ids == list(range(ids[0], ids[-1] + 1))
    listed = f"{ids[0]}-{ids[-1]}" if consecutive else ",".join(map(str, ids[:MOST_IDS]))
    more = ",..." if len(ids) > MOST_IDS and not consecutive else ""
    label = f"{tags[0].family}:{listed}{more}, {tags[0].side * 1e3:.6g} mm"
    return [("tag", "tag, side of its black square", (label,), "regular")]


def scale_column(factor: Point) -> Column:
    """Column with the drawing's scale, and the printer error that it compensates for, if any."""
    if factor == (1.0, 1.0):
        return "scale", "scale", ("1 : 1, print at 100 %",), "regular"
    printer, drawn = (
        ", ".join(f"{name} {value:.6g}" for name, value in zip("xy", pair, strict=True))
        for pair in ([1 / value for value in factor], factor)
    )
    return "scale", f"compensated for a printer that makes {printer} of 1", (f"drawn {drawn}; print at 100 %",), "bold"


def facts(frame: Frame, columns: Sequence[Column], y: float, name: str) -> list[Shape]:
    """Columns from margin to margin: a small gray heading above lines, the last of which stands at height y."""
    scale, left = frame.scale, frame.margin
    small, large, step = 1.35 * scale, 1.9 * scale, 3.2 * scale
    widths = [
        max(text_width(heading, small), *(text_width(line, large, face) for line in lines))
        for _, heading, lines, face in columns
    ]
    # On narrow paper, columns that would overlap shrink together.
    between = max(len(columns) - 1, 1)
    shrink = min(1.0, frame.width / (sum(widths) + 3 * scale * between))
    gap = (frame.width - shrink * sum(widths)) / between
    texts: list[Shape] = []
    for (slug, heading, lines, face), width in zip(columns, widths, strict=True):
        height = y + 4.4 * scale + step * (len(lines) - 1)
        texts.append(text(heading, left, height, small * shrink, color=GRAY, name=f"{name}-{slug}-heading"))
        for index, line in enumerate(reversed(lines)):
            suffix = f"-{len(lines) - 1 - index}" if len(lines) > 1 else ""
            texts.append(text(line, left, y + index * step, large * shrink, face=face, name=f"{name}-{slug}{suffix}"))
        left += shrink * width + gap
    return texts


def paragraph(
    content: str, left: float, top: float, width: float, height: float, lines: int, name: str, color: str = GRAY
) -> list[Shape]:
    """Words in at most `lines` lines below `top`, smaller than the cap height `height` (mm) if necessary."""
    step, rows = 1.94 * height, wrap(content, width, height)
    while len(rows) > lines or max(text_width(row, height) for row in rows) > width:
        height *= 0.96
        rows = wrap(content, width, height)
    return [
        text(row, left, top - height - index * step, height, color=color, name=f"{name}-{index}")
        for index, row in enumerate(rows)
    ]


def nameless_note(nameless: Sequence[str]) -> tuple[str, ...]:
    """Sentence about dots without room for their numbers."""
    if not nameless:
        return ()
    more = len(nameless) - MOST_LISTED
    listed = ", ".join(nameless[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")
    which = f"Dot {listed} has" if len(nameless) == 1 else f"Dots {listed} have"
    return (f"{which} no room for a number outside the quiet zones; see the coordinates in marker.json.",)
