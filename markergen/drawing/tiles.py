"""Tiles: a marker larger than the paper on several pages, to be cut and glued together."""

from collections.abc import Mapping, Sequence

from markergen.drawing import checks, furniture, rulers
from markergen.drawing.assembly import plan
from markergen.drawing.face import draw_face
from markergen.drawing.figure import Figure, is_disk, size_words
from markergen.drawing.furniture import LIGHT, Frame
from markergen.drawing.options import SheetOptions
from markergen.drawing.outline import HAIRLINE
from markergen.drawing.page import Sheet, compensated_note, moved_layers, nameless_note, scene_of
from markergen.drawing.scene import Box, Disk, Line, Shape, bounds
from markergen.drawing.tiling import CENTER, LEAST_ARM, STRIP, Tile, Tiling, cut_dots, registration, tiling
from markergen.drawing.transform import clipped, rectangle
from markergen.errors import InputError
from markergen.model.marker import marker_name

MOST_TILES = 100
"""Of one marker; more, and nobody glues them together."""

CROP = 4.0
"""Length of crop marks, mm."""

BLEED = 1.0
"""How far a printed ground goes on beyond a seam, mm."""

Layers = Mapping[str, Sequence[Shape]]


def tiled(figure: Figure, options: SheetOptions, frames: Sequence[Frame]) -> tuple[Sheet, ...]:
    """Plan of assembly and one sheet per tile, on the pages that give the fewest tiles, then those that cut no dot.

    Raises
    ------
    InputError
        If the overlap is too narrow for registration marks or wide for the paper, or there are over `MOST_TILES` tiles.
    """
    overlap = round(options.overlap * 1e3, 9)
    least, most = 2 * LEAST_ARM + 1, min(frames[0].width, frames[0].top - frames[0].margin) / 4
    if not least <= overlap <= most:
        raise InputError(f"an overlap of {least:g} to {most:.0f} mm", f"{overlap:g} mm", "10 mm suits most paper")
    tilings = [tiling(figure, frame, overlap, options.colors.grounded) for frame in frames]
    best = min(tilings, key=lambda each: (each.columns * each.rows, each.across.cut + each.upward.cut))
    if best.columns * best.rows > MOST_TILES:
        raise InputError(
            f"a marker that at most {MOST_TILES} tiles hold",
            f"{size_words(figure.marker.boundary)} on {best.frame.paper}: {best.columns} x {best.rows} tiles",
            "use larger paper",
        )
    layers, nameless = _layers(figure, options, best)
    pages = [_page(figure, best, tile, layers) for tile in best.tiles]
    notes = _notes(figure, options, best, nameless)
    return (plan(figure, best, notes), *pages)


def _layers(figure: Figure, options: SheetOptions, tiles: Tiling) -> tuple[Layers, Sequence[str]]:
    """All that is to be divided, mm, marker frame: the face, and crosses on the seams."""
    scale, color = tiles.frame.scale, options.colors.ink
    near = any(abs(place) < CENTER / 2 for place in (*tiles.across.places, *tiles.upward.places))
    bare = draw_face(figure, options.colors, scale, tiles.extent)
    lines = [shape for name in ("cut", "marks") for shape in bare.layers[name] if isinstance(shape, Line)]
    crosses = registration(tiles, figure, lines, color)
    left, bottom, right, top = tiles.extent
    seams = [Line(((x, bottom), (x, top)), HAIRLINE) for x in tiles.across.places]
    seams += [Line(((left, y), (right, y)), HAIRLINE) for y in tiles.upward.places]
    # Numbers keep off seams and crosses, as off all other ink, and stay on the tile of their dot.
    homes = [next(tile.box for tile in tiles.tiles if tile.holds(dot.x, dot.y)) for dot in figure.dots]
    face = draw_face(figure, options.colors, scale, tiles.extent, furniture.ink_points([*seams, *crosses]), homes)
    marks = [shape for shape in face.layers["marks"] if not (near and shape.name.startswith("center-"))]
    return {**face.layers, "marks": (*marks, *crosses)}, face.nameless


def _page(figure: Figure, tiles: Tiling, tile: Tile, layers: Layers) -> Sheet:
    paper = tiles.frame.paper
    dx, dy = tiles.shift(tile)
    placed = moved_layers(_part(tiles, tile, layers), dx, dy)
    box = tile.box[0] + dx, tile.box[1] + dy, tile.box[2] + dx, tile.box[3] + dy
    seams = tiles.seams_of(tile)
    crops = _crop_marks(tiles, box, seams)
    drawn = {**placed, "marks": (*placed["marks"], *crops)}
    strip, lengths = _strip(figure, tiles, tile, drawn, seams)
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
    """What of the face belongs on a tile.

    A dot is printed once, on the tile that it lies on; only one that a seam cuts is on several, as far as they reach.
    """
    left, bottom, right, top = tile.box
    window = tiles.printed(tile)
    cut = {dot.name for dot in cut_dots(tiles, [shape for shape in layers["dots"] if isinstance(shape, Disk)])}
    part: dict[str, list[Shape]] = {}
    for name, shapes in layers.items():
        if name in ("dots", "text"):
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
    """Short lines at both ends of every seam, at the edge of what is printed."""
    left, bottom, right, top = tiles.window
    half = tiles.overlap / 2
    length = min(CROP, half)
    # At a corner of seams in the overlap beyond; else at the end of the window.
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
    figure: Figure, tiles: Tiling, tile: Tile, drawn: Layers, seams: tuple[bool, bool, bool, bool]
) -> tuple[dict[str, tuple[Shape, ...]], tuple[int, int]]:
    """What tells which tile this is and whether it is true, at the foot of its page and beside it."""
    frame, scale = tiles.frame, tiles.frame.scale
    left, bottom, right, top = tiles.window
    band_scale = min(scale, 1.2)
    band = rulers.BAND * band_scale
    dots = [shape for shape in drawn["dots"] if isinstance(shape, Disk)]
    others = [shape for name, shapes in drawn.items() if name not in ("dots", "ground") for shape in shapes]
    # The overlap beside a printed ground is just wide enough for a ruler.
    air = rulers.AIR * band_scale
    boxes = [bounds(shape) for shape in drawn["ground"]]
    ground = [rectangle((b[0] + air, b[1] + air, b[2] - air, b[3] - air), "", "") for b in boxes]
    base = frame.margin + (STRIP - 5.2) * scale
    rule = Line(((left, frame.margin + 7.6 * scale), (right, frame.margin + 7.6 * scale)), HAIRLINE, "rule", LIGHT)
    x_length, (x_marks, x_text) = rulers.placed(
        [((left, base, right, base + band), 1)], 0, band_scale, figure.factor[0], (), (), "ruler"
    )
    sides: list[tuple[Box, int]] = [((left, bottom, left + band, top), 1), ((right - band, bottom, right, top), -1)]
    # Beside a seam it stands on what is cut off or covered.
    if not seams[0]:
        sides.reverse()
    y_length, (y_marks, y_text) = rulers.placed(
        sides, 1, band_scale, figure.factor[1], dots, [*others, *ground], "ruler-y"
    )
    lengths = (x_length, y_length)
    words = furniture.remedy(frame, checks.remedy(lengths), base - 1.7 * scale, 1.4 * scale)
    facts = furniture.facts(frame, _facts(figure, tiles, tile, lengths, seams), frame.margin, "tile")
    return {"marks": (rule, *x_marks, *y_marks), "text": (*x_text, *y_text, *words, *facts)}, lengths


def _facts(
    figure: Figure, tiles: Tiling, tile: Tile, lengths: tuple[int, int], seams: tuple[bool, bool, bool, bool]
) -> list[furniture.Column]:
    count = len(tiles.tiles)
    number = tile.row * tiles.columns + tile.column + 1
    edges = " and ".join(name for name, seam in (("left", seams[0]), ("top", seams[3])) if seam)
    here = [
        point for point, dot in zip(figure.marker.control_points, figure.dots, strict=True) if tile.holds(dot.x, dot.y)
    ]
    columns: list[furniture.Column] = [
        ("number", f"row {tile.row + 1}, column {tile.column + 1}", (f"tile {number} of {count}",), "bold"),
        ("page", tiles.frame.paper.name, (f"page {number + 1} of {count + 1}",), "regular"),
        ("spec", "spec", (marker_name(figure.marker).removeprefix("markergen-"),), "regular"),
        *([furniture.scale_column(figure.factor)] if figure.factor != (1.0, 1.0) else []),
        ("cut", "cut along marks", (edges or "nothing",), "regular"),
        ("rulers", "rulers to 0.1 mm", (checks.ruler_words(lengths),), "regular"),
    ]
    for axis, name in enumerate("xy"):
        pair = checks.far_pair(here, axis)
        if pair:
            heading = f"dots {pair.first} to {pair.second} along {name}"
            columns.append((name, heading, (f"{pair.between:.1f} mm, edges {pair.over:.1f}",), "regular"))
    return columns


def _notes(figure: Figure, options: SheetOptions, tiles: Tiling, nameless: Sequence[str]) -> tuple[str, ...]:
    boundary, paper = figure.marker.boundary, tiles.frame.paper
    count = len(tiles.tiles)
    shape = "disk" if is_disk(boundary) else "outline"
    why = "No paper up to A0 holds it" if options.paper is None else "With margins and rulers it needs more than a page"
    where = f"{count} tiles of {paper}: {tiles.layout_words}" if count > 1 else f"a page of {paper} with fewer words"
    how = "tells how to put them together" if count > 1 else "says the rest"
    notes = [
        f"The {shape} of the marker is {size_words(boundary)}. {why}, so it goes on {where}, after a page that {how}.",
        "Print at 100 %, then check the rulers on every page.",
    ]
    cut = [dot.name.removeprefix("dot-") for dot in cut_dots(tiles, figure.dots)]
    if cut:
        which = f"dot {cut[0]}" if len(cut) == 1 else f"dots {', '.join(cut)}"
        notes.append(f"A seam cuts {which}: no place for the seams avoids that, use larger paper or glue with care.")
    return (*notes, *compensated_note(figure), *nameless_note(nameless))
