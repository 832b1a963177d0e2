"""Foot of a sheet: rulers, axes, lengths to measure, remedies if they are off, and the title block."""
# tests: tests/drawing/test_sheet_layout.py

from collections.abc import Mapping, Sequence

from markergen.drawing.annotations import axis_arrows, facts, remedy_lines, title_block
from markergen.drawing.paper import Frame
from markergen.drawing.print_measurements import BAND, measured_columns, place_ruler, remedy_words, ruler
from markergen.drawing.scene import FINE, Disk, Point, Shape
from markergen.model.marker import Marker
from markergen.model.rescale import RULERS_MM


def draw_footer(
    frame: Frame,
    markers: Sequence[Marker],
    factor: Point,
    taken: Mapping[str, Sequence[Shape]],
    page: tuple[int, int],
    where: str = "",
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """Draw everything below and beside the markers; also return the lengths of the rulers.

    Parameters
    ----------
    markers : sequence of Marker
        Those on the page.
    factor : (x, y)
        Ratio of drawn to nominal lengths.
    taken : mapping of str to shapes
        Layers of what is on the page already.
    page : (number, total)
    where : str
        Words that say which of the markers the lengths to measure are in.
    """
    scale, left, base = frame.scale, frame.margin, frame.ruler_y
    axes_marks, axes_text = axis_arrows(frame)
    room = frame.width - 24 * scale
    x_length = next((length for length in RULERS_MM if length * factor[0] <= room), RULERS_MM[-1])
    x_marks, x_text = ruler((left, base), x_length, 0, scale, factor[0])
    band = BAND * scale
    others = [shape for name, shapes in taken.items() if name != "dots" for shape in shapes]
    dots = [shape for shape in taken["dots"] if isinstance(shape, Disk)]
    y_length, (y_marks, y_text) = place_ruler(
        [
            ((left, base - FINE / 2, left + band, frame.top), 1),
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
    remedy = remedy_lines(frame, remedy_words(lengths), frame.block_top + 7.6 * scale, 1.6 * scale)
    lines = facts(frame, measured_columns(markers[0], lengths, where), frame.checks_y, "check")
    block_marks, block_text = title_block(frame, markers, factor, page)
    layers: dict[str, tuple[Shape, ...]] = {
        "marks": (*x_marks, *y_marks, *axes_marks, *block_marks),
        "text": (*x_text, *y_text, *axes_text, *lines, *remedy, *block_text),
    }
    return layers, lengths
