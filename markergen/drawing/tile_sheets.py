"""Sheets of a marker larger than the paper: an assembly plan, and one page per tile."""

from collections.abc import Mapping, Sequence
from math import cos, pi, sin

import numpy as np
from numpy.typing import NDArray

from markergen.drawing.annotations import (
    Column,
    facts,
    nameless_note,
    paragraph,
    remedy_lines,
    scale_column,
    tag_column,
    title_block,
)
from markergen.drawing.colors import BLACK_ON_WHITE
from markergen.drawing.figure import Figure, compensated_note, is_disk, size_words
from markergen.drawing.marker_artwork import cut_lines, draw_artwork
from markergen.drawing.paper import SheetOptions
from markergen.drawing.print_measurements import AIR, BAND, far_pair, place_ruler, remedy_words, ruler_words
from markergen.drawing.scene import (
    BLACK,
    FINE,
    GRAY,
    HAIRLINE,
    LIGHT,
    Box,
    Disk,
    FilledPath,
    Line,
    Point,
    Shape,
    Sheet,
    bounds,
    clipped,
    ink_points,
    moved_layers,
    polygon,
    rectangle,
    scene_of,
)
from markergen.drawing.text import text, text_width, wrap
from markergen.drawing.tile_layout import CENTER, STRIP, Tile, Tiling, crossed, registration
from markergen.model.marker import marker_name

CROP = 4.0
"""Length of crop marks, mm."""

BLEED = 1.0
"""Extension of a printed ground beyond a seam, mm."""

Layers = Mapping[str, Sequence[Shape]]

PALE = "#c8c8c8"
"""Color of the dots in the plan's picture: too pale to be mistaken for the marker."""

CORNERS = 48
"""Number of corners of a dot in the plan's picture: a polygon, so that no program mistakes it for the marker either."""

LARGEST = 0.6
"""Maximum scale of the plan's picture: near 1 its dots would be mistaken for the marker's, on paper or in the file."""

MOST_LENGTHS = 4
"""Maximum number of lengths across seams listed for each axis."""


def tile_sheets(
    figure: Figure, options: SheetOptions, tiles: Tiling, page: tuple[int, int], smaller: str = ""
) -> tuple[Sheet, ...]:
    """Lay out an assembly plan, then one sheet per tile.

    Parameters
    ----------
    page : (number, total)
        Number of the plan among the pages of the file.
    smaller : str
        Words on what would need no tiles.
    """
    layers, nameless, about = _layers(figure, options, tiles)
    first, total = page
    pages = [_page(figure, tiles, tile, layers, (number, total)) for number, tile in enumerate(tiles.tiles, first + 1)]
    return (_plan(figure, tiles, (*_notes(figure, options, tiles, nameless, smaller), *about), page), *pages)


def _layers(figure: Figure, options: SheetOptions, tiles: Tiling) -> tuple[Layers, Sequence[str], Sequence[str]]:
    """Artwork and registration crosses to divide, mm, marker frame; dots without room for their number; notes."""
    scale, color = tiles.frame.scale, options.colors.ink
    near = any(abs(place) < CENTER / 2 for place in (*tiles.across.places, *tiles.upward.places))
    bare = draw_artwork(figure, options.colors, scale, tiles.extent)
    lines = [shape for name in ("cut", "marks") for shape in bare.layers[name] if isinstance(shape, Line)]
    crosses = registration(tiles, figure, lines, color)
    left, bottom, right, top = tiles.extent
    seams = [Line(((x, bottom), (x, top)), HAIRLINE) for x in tiles.across.places]
    seams += [Line(((left, y), (right, y)), HAIRLINE) for y in tiles.upward.places]
    # Numbers avoid seams and crosses, like all other ink, and stay on the tile of their dot.
    homes = [next(tile.box for tile in tiles.tiles if tile.holds(dot.x, dot.y)) for dot in figure.dots]
    artwork = draw_artwork(figure, options.colors, scale, tiles.extent, ink_points([*seams, *crosses]), homes)
    marks = [shape for shape in artwork.layers["marks"] if not (near and shape.name.startswith("center-"))]
    return {**artwork.layers, "marks": (*marks, *crosses)}, artwork.nameless, artwork.notes


def _page(figure: Figure, tiles: Tiling, tile: Tile, layers: Layers, page: tuple[int, int]) -> Sheet:
    paper = tiles.frame.paper
    dx, dy = tiles.shift(tile)
    placed = moved_layers(_part(tiles, tile, layers), dx, dy)
    box = tile.box[0] + dx, tile.box[1] + dy, tile.box[2] + dx, tile.box[3] + dy
    seams = tiles.seams_of(tile)
    crops = _crop_marks(tiles, box, seams)
    drawn = {**placed, "marks": (*placed["marks"], *crops)}
    strip, lengths = _strip(figure, tiles, tile, drawn, seams, page)
    number = tile.row * tiles.columns + tile.column + 1
    return Sheet(
        paper,
        scene_of([drawn, strip]),
        ((dx, dy),),
        lengths,
        marker_name(figure.marker),
        f"Tile {number} of {len(tiles.tiles)}, row {tile.row + 1}, column {tile.column + 1}, of a fiducial marker with "
        f"{len(figure.marker)} dots, {size_words(figure.marker.boundary)}, at true size on {paper}. Print at 100 %.",
        (),
        (
            box[0] if seams[0] else 0.0,
            box[1] if seams[1] else 0.0,
            box[2] if seams[2] else paper.width,
            box[3] if seams[3] else paper.height,
        ),
    )


def _part(tiles: Tiling, tile: Tile, layers: Layers) -> dict[str, list[Shape]]:
    """Part of the artwork on a tile.

    Dots, tag and numbers are printed only on the tile that contains their center, but what a seam goes through on every
    tile that it overlaps.
    """
    left, bottom, right, top = tile.box
    window = tiles.printed(tile)
    cut = {shape.name for shape in crossed(tiles, [*layers["dots"], *layers["tag"]])}
    part: dict[str, list[Shape]] = {}
    for name, shapes in layers.items():
        if name in ("dots", "tag", "text"):
            part[name] = []
            for shape in shapes:
                low_x, low_y, high_x, high_y = bounds(shape)
                x, y = (low_x + high_x) / 2, (low_y + high_y) / 2
                if shape.name in cut:
                    part[name] += clipped([shape], window)
                elif tile.holds(x, y):
                    part[name].append(shape)
        elif name == "ground":
            seams = [BLEED if seam else 0.0 for seam in tiles.seams_of(tile)]
            part[name] = list(clipped(shapes, (left - seams[0], bottom - seams[1], right + seams[2], top + seams[3])))
        else:
            part[name] = list(clipped(shapes, window))
    return part


def _crop_marks(tiles: Tiling, box: Box, seams: tuple[bool, bool, bool, bool]) -> list[Shape]:
    """Short lines at both ends of every seam, at the edge of the printed area."""
    left, bottom, right, top = tiles.window
    half = tiles.overlap / 2
    length = min(CROP, half)
    # In the overlap beyond where seams meet; otherwise at the end of the window.
    low_y, high_y = (box[1] - half if seams[1] else bottom), (box[3] + half if seams[3] else top)
    low_x, high_x = (box[0] - half if seams[0] else left), (box[2] + half if seams[2] else right)
    marks: list[Shape] = []
    for side, name in ((0, "left"), (2, "right")):
        if seams[side]:
            x = box[side]
            marks.append(Line(((x, low_y), (x, low_y + length)), HAIRLINE, f"crop-{name}-below"))
            marks.append(Line(((x, high_y - length), (x, high_y)), HAIRLINE, f"crop-{name}-above"))
    for side, name in ((1, "below"), (3, "above")):
        if seams[side]:
            y = box[side]
            marks.append(Line(((low_x, y), (low_x + length, y)), HAIRLINE, f"crop-{name}-left"))
            marks.append(Line(((high_x - length, y), (high_x, y)), HAIRLINE, f"crop-{name}-right"))
    return marks


def _strip(
    figure: Figure,
    tiles: Tiling,
    tile: Tile,
    drawn: Layers,
    seams: tuple[bool, bool, bool, bool],
    page: tuple[int, int],
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """Draw a tile's rulers beside it and at the foot of the page, and the strip that identifies it."""
    frame, scale = tiles.frame, tiles.frame.scale
    left, bottom, right, top = tiles.window
    band_scale = min(scale, 1.2)
    band = BAND * band_scale
    dots = [shape for shape in drawn["dots"] if isinstance(shape, Disk)]
    others = [shape for name, shapes in drawn.items() if name not in ("dots", "ground") for shape in shapes]
    # The overlap next to a printed ground is just wide enough for a ruler.
    air = AIR * band_scale
    boxes = [bounds(shape) for shape in drawn["ground"]]
    ground = [rectangle((b[0] + air, b[1] + air, b[2] - air, b[3] - air), "", "") for b in boxes]
    base = frame.margin + (STRIP - 5.2) * scale
    rule = Line(((left, frame.margin + 7.6 * scale), (right, frame.margin + 7.6 * scale)), HAIRLINE, "rule", LIGHT)
    x_length, (x_marks, x_text) = place_ruler(
        [((left, base, right, base + band), 1)], 0, band_scale, figure.factor[0], (), (), "ruler"
    )
    sides: list[tuple[Box, int]] = [((left, bottom, left + band, top), 1), ((right - band, bottom, right, top), -1)]
    # Next to a seam the ruler stands where it is cut off or covered.
    if not seams[0]:
        sides.reverse()
    y_length, (y_marks, y_text) = place_ruler(
        sides, 1, band_scale, figure.factor[1], dots, [*others, *ground], "ruler-y"
    )
    lengths = (x_length, y_length)
    words = remedy_lines(frame, remedy_words(lengths), base - 1.7 * scale, 1.4 * scale)
    columns = facts(frame, _facts(figure, tiles, tile, lengths, seams, page), frame.margin, "tile")
    return {"marks": (rule, *x_marks, *y_marks), "text": (*x_text, *y_text, *words, *columns)}, lengths


def _facts(
    figure: Figure,
    tiles: Tiling,
    tile: Tile,
    lengths: tuple[int, int],
    seams: tuple[bool, bool, bool, bool],
    page: tuple[int, int],
) -> list[Column]:
    count = len(tiles.tiles)
    number = tile.row * tiles.columns + tile.column + 1
    edges = " and ".join(name for name, seam in (("left", seams[0]), ("top", seams[3])) if seam)
    here = [
        point for point, dot in zip(figure.marker.control_points, figure.dots, strict=True) if tile.holds(dot.x, dot.y)
    ]
    columns: list[Column] = [
        ("number", f"row {tile.row + 1}, column {tile.column + 1}", (f"tile {number} of {count}",), "bold"),
        ("page", tiles.frame.paper.name, (f"page {page[0]} of {page[1]}",), "regular"),
        ("spec", "spec", (marker_name(figure.marker).removeprefix("markergen-"),), "regular"),
        *tag_column([figure.marker]),
        *([scale_column(figure.factor)] if figure.factor != (1.0, 1.0) else []),
        ("cut", "cut along marks", (edges or "nothing",), "regular"),
        ("rulers", "rulers to 0.1 mm", (ruler_words(lengths),), "regular"),
    ]
    for axis, name in enumerate("xy"):
        pair = far_pair(here, axis)
        if pair:
            heading = f"dots {pair.first} to {pair.second} along {name}"
            columns.append((name, heading, (f"{pair.between:.1f} mm, edges {pair.over:.1f}",), "regular"))
    return columns


def _notes(
    figure: Figure, options: SheetOptions, tiles: Tiling, nameless: Sequence[str], smaller: str
) -> tuple[str, ...]:
    boundary, paper = figure.marker.boundary, tiles.frame.paper
    count = len(tiles.tiles)
    shape = "disk" if is_disk(boundary) else "outline"
    why = "No paper up to A0 holds it" if options.paper is None else "With margins and rulers it needs more than a page"
    where = f"{count} tiles of {paper}: {tiles.layout_words}" if count > 1 else f"a page of {paper} with fewer words"
    how = "tells how to put them together" if count > 1 else "says the rest"
    notes = [
        f"The {shape} of the marker is {size_words(boundary)}. {why}, so it goes on {where}, after a page that {how}.",
        *([f"To print it on one: {smaller}."] if smaller else []),
        "Print at 100 %, then check the rulers on every page.",
    ]
    cut = [dot.name.removeprefix("dot-") for dot in crossed(tiles, figure.dots)]
    which = [f"dot {cut[0]}" if len(cut) == 1 else f"dots {', '.join(cut)}"] if cut else []
    which += ["the tag"] if crossed(tiles, figure.tag) else []
    if which:
        cuts = " and ".join(which)
        notes.append(f"A seam cuts {cuts}: no place for the seams avoids that, use larger paper or glue with care.")
    return (*notes, *compensated_note(figure), *nameless_note(nameless))


def _plan(figure: Figure, tiles: Tiling, notes: tuple[str, ...], page: tuple[int, int]) -> Sheet:
    """Assembly plan; it is neither cut nor measured."""
    frame, scale, paper = tiles.frame, tiles.frame.scale, tiles.frame.paper
    left, width, top = frame.margin, frame.width, frame.top
    count = len(tiles.tiles)
    size = size_words(figure.marker.boundary)
    texts: list[Shape] = [text("Assembly plan", left, top - 3.8 * scale, 3.8 * scale, face="bold", name="plan-title")]
    what = f"{count} tiles in {tiles.layout_words}, for" if count > 1 else "the other has"
    subtitle = f"Page {page[0]} of {page[1]}: {what} a marker of {size}"
    texts += paragraph(subtitle, left, top - 6.5 * scale, width, 1.9 * scale, 2, "plan-subtitle")
    block_marks, block_text = title_block(frame, [figure.marker], figure.factor, page)
    low = frame.block_top + 4 * scale
    steps, high = _steps(figure, tiles, low, page[0] + 1)
    marks, numbers = _picture(figure, tiles, (left, high + 5 * scale, frame.right, top - 13 * scale))
    return Sheet(
        paper,
        scene_of([{"marks": (*marks, *block_marks), "text": (*texts, *numbers, *steps, *block_text)}]),
        (),
        (0, 0),
        marker_name(figure.marker),
        f"Assembly plan for {count} tiles of a fiducial marker with {len(figure.marker)} dots, {size}, on {paper}.",
        notes,
        (0.0, 0.0, paper.width, paper.height),
    )


def _picture(figure: Figure, tiles: Tiling, room: Box) -> tuple[list[Shape], list[Shape]]:
    """Small picture of all tiles in a part of the page, with their numbers; edges to cut are dashed."""
    scale = tiles.frame.scale
    left, bottom, right, top = tiles.extent
    small = min((room[2] - room[0]) / (right - left), (room[3] - room[1]) / (top - bottom), LARGEST)
    dx, dy = (room[0] + room[2]) / 2, (room[1] + room[3]) / 2

    def at(x: float, y: float) -> Point:
        return dx + small * (x - (left + right) / 2), dy + small * (y - (bottom + top) / 2)

    marks: list[Shape] = []
    for dot in figure.dots:
        segments = polygon(_circle(at(dot.x, dot.y), small * dot.radius), "", PALE).segments
        if dot.inner_radius:
            hole = _circle(at(dot.x, dot.y), small * dot.inner_radius)[::-1]
            segments += polygon(hole, "", PALE).segments
        marks.append(FilledPath(segments, f"plan-{dot.name}", PALE))
    squares = [bounds(shape) for shape in figure.tag]
    marks += [rectangle((*at(*box[:2]), *at(*box[2:])), "plan-tag", PALE) for box in squares]
    edges = [
        Line(tuple(at(*point) for point in line.points), HAIRLINE, f"plan-{line.name}", LIGHT)
        for line in cut_lines(figure, BLACK_ON_WHITE)
    ]
    marks += edges
    corners = (at(left, bottom), at(right, bottom), at(right, top), at(left, top), at(left, bottom))
    marks.append(Line(corners, FINE, "plan-edge", GRAY))
    for index, x in enumerate(tiles.across.places):
        marks += _dashed(at(x, bottom), at(x, top), f"plan-across-{index}")
    for index, y in enumerate(tiles.upward.places):
        marks += _dashed(at(left, y), at(right, y), f"plan-upward-{index}")
    texts: list[Shape] = []
    # Labels avoid dots and outline.
    near = ink_points(edges)
    disks = np.array([(*at(dot.x, dot.y), small * dot.radius) for dot in figure.dots])
    tags = [((left + right) / 2, (low + high) / 2, right - left) for left, low, right, high in squares]
    around = [(*at(x, y), 0.6 * small * side) for x, y, side in tags]
    disks = np.concatenate([disks, np.array(around).reshape(-1, 3), np.column_stack([near, np.ones(len(near))])])
    for number, tile in enumerate(tiles.tiles, 1):
        (x0, y0), (x1, y1) = at(*tile.box[:2]), at(*tile.box[2:])
        label = f"row {tile.row + 1}, column {tile.column + 1}"
        height = min(5 * scale, (y1 - y0) / 4, (x1 - x0) / 4)
        fine = min(0.34 * height, 0.34 * height * 0.9 * (x1 - x0) / text_width(label, 0.34 * height))
        wide, high, pad = text_width(label, fine), height + 2.2 * fine, 0.4 * height
        # The upper left corner, or the place where it hides least.
        xs, ys = (x0 + pad, (x0 + x1 - wide) / 2, x1 - pad - wide), (y1 - pad - high, (y0 + y1 - high) / 2, y0 + pad)
        places = [(x, y) for y in ys for x in xs]
        x, y = max(places, key=lambda place: min(_gap(place, (wide, high), disks), 0.0))
        texts.append(text(str(number), x, y + 2.2 * fine, height, face="bold", name=f"plan-tile-{number}"))
        texts.append(text(label, x, y, fine, color=GRAY, name=f"plan-tile-{number}-label"))
    return marks, texts


def _gap(place: Point, size: Point, disks: NDArray[np.float64]) -> float:
    """Gap between a box, given by its lower left corner, and the nearest disk (x, y, radius); negative for overlap."""
    low = np.array(place)
    beyond = np.maximum(np.maximum(low - disks[:, :2], disks[:, :2] - low - size), 0)
    return float(np.min(np.hypot(*beyond.T) - disks[:, 2]))


def _circle(center: Point, radius: float) -> list[Point]:
    angles = (2 * pi * index / CORNERS for index in range(CORNERS))
    return [(center[0] + radius * cos(angle), center[1] + radius * sin(angle)) for angle in angles]


def _dashed(start: Point, end: Point, name: str) -> list[Line]:
    """Dashes of 3 mm with gaps of 2 mm along a horizontal or vertical line."""
    axis = 0 if end[0] > start[0] else 1
    dashes, place, number = [], start[axis], 0
    while place < end[axis]:
        stop = min(place + 3.0, end[axis])
        points = [(place, start[1]), (stop, start[1])] if axis == 0 else [(start[0], place), (start[0], stop)]
        dashes.append(Line(tuple(points), FINE, f"{name}-{number}", BLACK))
        place, number = place + 5.0, number + 1
    return dashes


def _steps(figure: Figure, tiles: Tiling, low: float, first: int) -> tuple[list[Shape], float]:
    """Numbered paragraphs ending at height `low`, and the height of their upper end."""
    frame, scale = tiles.frame, tiles.frame.scale
    height, indent = 1.75 * scale, 5 * scale
    rows: list[tuple[str, str]] = []
    for number, step in enumerate(_words(figure, tiles, first), 1):
        for index, line in enumerate(wrap(step, frame.width - indent, height)):
            rows.append((f"{number}" if index == 0 else "", line))
    step_up, y = 1.85 * height, low
    texts: list[Shape] = []
    for index, (number_text, line) in reversed(list(enumerate(rows))):
        texts.append(text(line, frame.margin + indent, y, height, name=f"step-{index}"))
        if number_text:
            texts.append(text(number_text, frame.margin, y, height, face="bold", name=f"step-number-{number_text}"))
            y += 0.6 * height
        y += step_up
    return texts, y


def _words(figure: Figure, tiles: Tiling, first: int) -> list[str]:
    """Instructions for tiles that are on the pages from `first` on."""
    count = len(tiles.tiles)
    half = f"{tiles.overlap / 2:g}"
    if count == 1:
        return [
            f"Print page {first} at 100 % (actual size, not fitted to the page). Its rulers must be true to 0.1 mm; it "
            "says what to do if they are not. Nothing is to be cut or glued."
        ]
    steps = [
        f"Print pages {first} to {first + count - 1} at 100 % (actual size, not fitted to the page), all on the same "
        "printer. The rulers on every page must be true to 0.1 mm; each page says what to do if they are not.",
        "Cut tiles along the crop marks on their left and upper edges where another tile joins (dashed lines); "
        f"each page says which. Leave right and lower edges: {half} mm and the margin beyond lie under the next tile.",
        "Begin with tile 1. Lay each next tile onto the edge of its neighbor so that every cross on the seam is whole: "
        "the cut edge along one arm, the two halves of the other in line. Glue row by row, then row to row, on a flat, "
        "stiff board.",
    ]
    lengths = _across(figure, tiles)
    if lengths:
        steps.append(
            f"Measure across the seams, before the glue is dry: {'; '.join(lengths)}. Move the tiles until this is so "
            "within 0.2 mm. Or measure the dots as they are and use them: markergen rescale marker.json "
            "--measured-points dots.csv -o printed.json"
        )
    return steps


def _across(figure: Figure, tiles: Tiling) -> Sequence[str]:
    """Lengths between dots on opposite sides of the seams."""
    found: list[str] = []
    for axis, cuts in enumerate((tiles.across, tiles.upward)):
        for place in cuts.places[:MOST_LENGTHS]:
            pair = far_pair(figure.marker.control_points, axis, place / figure.factor[axis] / 1e3)
            if pair and str(pair) not in found:
                found.append(str(pair))
    return found
