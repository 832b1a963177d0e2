"""Fabrication drawing of a rig: views of the whole, datums, tolerances between its faces, and each face.

The first page shows six views around the main one, and a picture from a corner.

+-----------------------------------------------+
|            +-----+              ___           |
|            | -v  |             /__/|  picture |
|            +-----+             |  ||          |
|   +-----+  +-----+  +-----+  +-----+          |
|   | +u  |  | main|  | -u  |  |rear |          |
|   +-----+  +-----+  +-----+  +-----+          |
|            +-----+                            |
|            | +v  |  first-angle projection    |
|            +-----+                            |
+-----------------------------------------------+

In third-angle projection, on American paper, opposite views change places.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from shlex import quote
from typing import Literal

import numpy as np

from markergen.arrays import Array
from markergen.drawing.paper import Frame, SheetOptions
from markergen.drawing.scene import GRAY, Box, Line, Point, Shape, closed_line
from markergen.drawing.text import text_width, written
from markergen.geometry.contour import flattened
from markergen.geometry.outlines import polygon
from markergen.model.body import Plate
from markergen.model.body_json import rig_name
from markergen.model.boundary import Polygon
from markergen.model.fabrication import Fabrication
from markergen.model.rig import Rig
from markergen.solid.primitives import OFF, Prism, at_height
from markergen.workshop.assembly import BlockFace, MadeBody
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.drafting.content import title_block, workpiece
from markergen.workshop.drafting.details import SCALES
from markergen.workshop.drafting.drawing import (
    Control,
    Dimension,
    DrawingTable,
    SectionView,
    TitleBlock,
    ViewFace,
    Workpiece,
    around,
    exact,
    fixed,
    millimeters,
)
from markergen.workshop.drafting.features import PLUS_MINUS
from markergen.workshop.drafting.pen import (
    CLOSE,
    THIN,
    DrawingView,
    Style,
    across,
    arrow,
    center_line,
    drawn,
    lettering,
    on_white,
    vertical_dimension,
)
from markergen.workshop.drafting.symbols import datum_letter, datum_reach, frame_width, tolerance_frame
from markergen.workshop.drafting.title_block import first_angle
from markergen.workshop.drafting.views import FrontPage, best_on_paper, drawing_area
from markergen.workshop.processes import Accuracy

LETTERS = "RST"
"""Datums of the whole; A, B and C are those of each face on its own sheet."""

STRAIGHT = 1e-6
"""Maximum sine of the angle between directions that count as parallel."""

SHOWN = 0.15
"""Minimum cosine of the angle between a face's normal and the line of sight, for its dots and name to show."""

CORNER = np.array([0.62, -0.62, 0.48])
"""Direction from which the picture is seen, where the main view is from -y with z up."""

AXES = ((0, "x"), (1, "y"), (2, "z"))

TURNS = 48
"""Number of corners of a dot that is seen at an angle."""

FRAME = (
    "Rig frame: origin and axes as drawn in the main view. Each marker has a frame of its own: x to the right, y up "
    "and z out of its face as its sheet shows it; the table gives its origin in the rig frame, and where its "
    "axes point."
)
EXACT = "Places and directions in the table of faces are theoretically exact."
DATUMS = "R, S and T are the datums of the whole, A, B and C those of each face on its own sheet."
MOUNT = (
    "The plates are made one by one and mounted so that they are at these places. Measure the relation of the mounted "
    "plates by photographs, with {}."
)
ONE = "The body is one piece; what its sheets call the plate is the body under that face."
STEP = "The exact geometry is in the STEP file of the same name; take no sizes from the drawing."


@dataclass(frozen=True)
class FaceName:
    """Name of a face at a point of a view, its width there, and its tolerances and datum if it is seen straight on."""

    text: str
    at: Point
    width: float
    controls: tuple[Control, ...] = ()
    datum: str = ""


@dataclass(frozen=True)
class RigView:
    """A view of a rig, mm.

    Attributes
    ----------
    place : str
        Key of `PLACES`.
    text : str
        ``seen from -y``.
    faces : tuple of ViewFace
        The farthest first.
    axes : (str, str)
        Axes of the rig frame to the right and up.
    """

    place: str
    text: str
    faces: tuple[ViewFace, ...]
    names: tuple[FaceName, ...]
    axes: tuple[str, str] = ("", "")


@dataclass(frozen=True)
class RigWork:
    """Content of the sheets of a whole rig: views, the picture from a corner, sizes in words, tables and notes.

    Attributes
    ----------
    sizes : (str, str, str)
        Overall size of the main view to the right and up, and its depth.
    """

    block: TitleBlock
    views: tuple[RigView, ...]
    picture: RigView
    sizes: tuple[str, str, str]
    tables: tuple[DrawingTable, ...]
    notes: tuple[str, ...]


def rig_work(rig: Rig, fabrication: Fabrication, made: MadeBody, record: str = "") -> RigWork:
    """Describe a rig as designed, and its parts from `parts_of_rig`, for the sheets of the whole.

    The command with which it is measured names its file, the `record`, if there is one that the font can write.
    """
    accuracy, sides = made.made[0].accuracy, _sides(made)
    datums = _datums(sides)
    main = _main_view(rig)
    views = tuple(_view(place, axes, rig, made, sides, datums, accuracy) for place, axes in _six(main))
    drawn = [view for view in views if view.place in ("main", "+u", "+v") or view.names]
    boxes = {view.place: around(view.faces) for view in views}
    spans = (boxes["main"][2] - boxes["main"][0], boxes["main"][3] - boxes["main"][1], boxes["+u"][2] - boxes["+u"][0])
    limits = f" {PLUS_MINUS}{millimeters(accuracy.thickness)}"
    sizes = [f"{millimeters(span)}{limits}" if made.block else f"({millimeters(span)})" for span in spans]
    count = len(rig.markers)
    what = "one body" if made.block else f"{count} plates"
    lines = dict.fromkeys(line for plate in made.made for line in plate.lines)
    is_named = record and written(record) == record
    mount = MOUNT.format(f"markergen calibrate {quote(record)} photos/" if is_named else "markergen calibrate")
    return RigWork(
        block=title_block(
            rig_name(rig), f"Fiducial markers on {what}, {count} faces, {len(rig)} dots", fabrication, accuracy
        ),
        views=tuple(drawn),
        picture=_picture(main, rig, made),
        sizes=(sizes[0], sizes[1], sizes[2]),
        tables=(_face_table(rig), *_relation_tables(rig, made, sides, datums, accuracy)),
        notes=(FRAME, EXACT, *((DATUMS, ONE, *lines) if made.block else (mount,)), STEP),
    )


def face_works(rig: Rig, fabrication: Fabrication, made: MadeBody) -> list[Workpiece]:
    """Describe each marker of a rig for its own sheets: its plate, or its face of the body."""
    works = []
    for k, (plate, result) in enumerate(zip(rig.markers, made.made, strict=True)):
        work = _face_work(plate, made, k, fabrication) if made.block else workpiece(plate.marker, fabrication, result)
        block = replace(work.block, title=f"{plate.name}: {work.block.title}", name=f"{rig_name(rig)}, {plate.name}")
        works.append(replace(work, block=block))
    return works


def in_common(works: Sequence[Workpiece], notes: Sequence[str]) -> Workpiece:
    """What the drawings of a body's faces say together: what is the same of all once, and the rest by face.

    Its notes are those of the whole, and then those of the faces.
    """
    # Each face says where its geometry is, too.
    sentences = [*(note for note in notes if note != STEP), *(note for work in works for note in work.notes)]
    tables, sections = dict[object, tuple[DrawingTable, list[str]]](), dict[object, tuple[SectionView, list[str]]]()
    for work in works:
        face = work.block.name.partition(", ")[2]
        for table in work.tables:
            tables.setdefault((table.title, table.headings, table.rows), (table, []))[1].append(face)
        for section in work.sections:
            texts = tuple(dimension.text for dimension in (*section.across, *section.upright))
            sections.setdefault((section.title, texts), (section, []))[1].append(face)

    def titled(title: str, faces: Sequence[str]) -> str:
        return f"{title}, of each face" if len(faces) == len(works) else f"{', '.join(faces)}: {title}"

    order = list(dict.fromkeys(table.title for table, _ in tables.values()))
    in_order = sorted(tables.values(), key=lambda pair: order.index(pair[0].title))
    return replace(
        works[0],
        tables=tuple(replace(table, title=titled(table.title, faces)) for table, faces in in_order),
        sections=tuple(replace(section, title=titled(section.title, faces)) for section, faces in sections.values()),
        notes=tuple(dict.fromkeys(sentences)),
    )


def _sides(made: MadeBody) -> tuple[BlockFace, ...]:
    """Flat sides that can be datums: faces of the block, or of the plates."""
    if made.block:
        return made.block
    sides: dict[str, BlockFace] = {}
    for part in made.parts:
        piece, name = part.pieces[0], part.name.rpartition("/")[0]
        prism = piece.part.add[0]
        if piece.part.is_plate and isinstance(prism, Prism):
            corners = tuple(flattened(prism.outer, OFF))
            sides.setdefault(name, BlockFace(name, corners, piece.rotation, piece.translation, prism.top))
    return tuple(sides.values())


def _datums(sides: Sequence[BlockFace]) -> list[BlockFace]:
    """Up to three sides: the first, one at a right angle to it if there is one, and one that fixes what is left."""
    chosen = [sides[0]]
    while len(chosen) < 3:
        normals = np.array([side.normal for side in chosen])
        # How far each normal is from the directions that are fixed, the farthest first.
        away = [np.linalg.norm(side.normal - np.linalg.pinv(normals) @ (normals @ side.normal)) for side in sides]
        best = int(np.argmax(np.round(away, 9)))
        if away[best] < STRAIGHT:
            break
        chosen.append(sides[best])
    return chosen


def _main_view(rig: Rig) -> tuple[Array, Array, Array]:
    """Directions to the right and up in the main view, and toward the viewer: -y, or where more faces point."""
    normals = np.array([plate.rotation_matrix[:, 2] for plate in rig.markers])
    x, y, z = np.eye(3)
    ways = [(x, z, -y), (x, y, z), (y, z, x), (-x, z, y), (-y, z, -x), (x, -y, -z)]
    return max(ways, key=lambda way: round(float(np.maximum(normals @ way[2], 0).sum()), 6))


def _six(main: tuple[Array, Array, Array]) -> list[tuple[str, tuple[Array, Array, Array]]]:
    """The six views: directions to the right, up and toward the viewer."""
    u, v, d = main
    return [
        ("main", (u, v, d)),
        ("+u", (-d, v, u)),
        ("-u", (d, v, -u)),
        ("+v", (u, -d, v)),
        ("-v", (u, d, -v)),
        ("rear", (-u, v, -d)),
    ]


def _words(way: Array) -> str:
    """``-y`` for a direction along an axis."""
    k = int(np.argmax(np.abs(way)))
    return f"{'-' if way[k] < 0 else ''}{'xyz'[k]}"


def _view(
    place: str, axes: tuple[Array, Array, Array], rig: Rig, made: MadeBody, sides: Sequence[BlockFace],
    datums: Sequence[BlockFace], accuracy: Accuracy,
) -> RigView:  # fmt: skip
    flat, toward = np.stack(axes[:2], axis=1), axes[2]
    names = []
    marked = {plate.name: plate for plate in rig.markers}
    letters = {side.name: letter for letter, side in zip(LETTERS, datums, strict=False)} if made.block else {}
    for side in sides:
        slope = float(side.normal @ toward)
        straight = slope > 1 - STRAIGHT
        if slope < SHOWN or not (side.name in marked or (straight and side.name in letters)):
            continue
        controls = _controls(side, datums, accuracy) if straight and made.block else ()
        letter = letters.get(side.name, "") if straight else ""
        names.append(_name(side.name, side.ring() @ flat, marked.get(side.name), flat, controls, letter))
    way = _words(toward)
    return RigView(
        place,
        f"seen from {way if way.startswith('-') else f'+{way}'}",
        _projected(axes, rig, made),
        tuple(names),
        (_words(axes[0]), _words(axes[1])),
    )


def _picture(main: tuple[Array, Array, Array], rig: Rig, made: MadeBody) -> RigView:
    """The whole seen from a corner."""
    basis = np.stack([main[0], -main[2], main[1]], axis=1)
    toward = basis @ (CORNER / np.linalg.norm(CORNER))
    right = np.cross(main[1], toward)
    right /= np.linalg.norm(right)
    axes = (right, np.cross(toward, right), toward)
    flat = np.stack(axes[:2], axis=1)
    names = []
    for plate in rig.markers:
        if plate.rotation_matrix[:, 2] @ toward > SHOWN:
            rim = at_height(np.concatenate(plate.marker.boundary.outlines()), 0.0)
            names.append(_name(plate.name, 1e3 * plate.to_body(rim) @ flat, plate, flat))
    return RigView("picture", "seen from a corner, not to scale", _projected(axes, rig, made), tuple(names))


def _name(
    label: str, ring: Array, plate: Plate | None, flat: Array, controls: tuple[Control, ...] = (), datum: str = ""
) -> FaceName:
    """Name of a face, of which corners (m, 2) are seen, where its marker has the most room between dots and tag."""
    middle = (ring.min(axis=0) + ring.max(axis=0)) / 2
    ends = np.concatenate([ring, (ring + np.roll(ring, 1, axis=0)) / 2])
    places = np.concatenate(
        [[middle], *(middle + share * (ends - middle) * [0.6, 1.0] for share in (0.35, 0.55, 0.75))]
    )
    if plate is not None:
        marker, tag = plate.marker, plate.marker.tag
        centers, radii = marker.xyz, [500 * point.feature.diameter for point in marker.control_points]
        if tag is not None:
            centers, radii = np.vstack([centers, [*tag.center, 0.0]]), [*radii, 500 * np.sqrt(2) * tag.side]
        drawn = 1e3 * plate.to_body(centers) @ flat
        # Names are wider than high.
        room = np.linalg.norm((places[:, None] - drawn) * [0.5, 1.0], axis=-1) - radii
        middle = places[int(np.argmax(np.round(room.min(axis=1), 6)))]
    x, y = middle
    return FaceName(label, (float(x), float(y)), float(np.ptp(ring[:, 0])), controls, datum)


def _projected(axes: tuple[Array, Array, Array], rig: Rig, made: MadeBody) -> tuple[ViewFace, ...]:
    """Visible faces of the body or the plates with dots and tags on them, the farthest first."""
    flat, toward = np.stack(axes[:2], axis=1), axes[2]
    groups: list[tuple[float, list[ViewFace]]] = []
    if made.block:
        for k, face in enumerate(made.block):
            if face.normal @ toward > STRAIGHT:
                faces = [_face(face.ring() @ flat)]
                faces += _ink(rig.markers[k], flat) if k < len(rig.markers) and face.normal @ toward > SHOWN else []
                groups.append((float(face.ring().mean(axis=0) @ toward), faces))
    else:
        for plate in rig.markers:
            groups.append(_plates(plate, made, flat, toward))
    groups.sort(key=lambda group: round(group[0], 6))
    return tuple(face for _, faces in groups for face in faces)


def _plates(plate: Plate, made: MadeBody, flat: Array, toward: Array) -> tuple[float, list[ViewFace]]:
    """Distance toward the viewer of a marker's plates, and what is seen of them: convex hull, face, dots."""
    from scipy.spatial import ConvexHull

    faces, depth = [], 0.0
    for part in made.parts:
        piece = part.pieces[0]
        body = piece.part.add[0]
        if not piece.part.is_plate or part.name.rpartition("/")[0] != plate.name or not isinstance(body, Prism):
            continue
        ring = np.array(flattened(body.outer, OFF))
        ends = [piece.to_body(at_height(ring, z)) for z in body.span]
        depth = float(np.concatenate(ends).mean(axis=0) @ toward)
        points = np.concatenate(ends) @ flat
        faces.append(_face(points[ConvexHull(points).vertices]))
        slope = float(plate.rotation_matrix[:, 2] @ toward)
        if abs(slope) > SHOWN:
            faces.append(_face(ends[slope > 0] @ flat))
    if plate.rotation_matrix[:, 2] @ toward > SHOWN:
        faces += _ink(plate, flat)
    return depth, faces


def _face(ring: Array, material: str = "light", fine: bool = False) -> ViewFace:
    return ViewFace((polygon(ring),), material, fine=fine)


def _ink(plate: Plate, flat: Array) -> list[ViewFace]:
    """Dots and tag of a marker as they are seen."""
    turns = 2 * np.pi * np.arange(TURNS) / TURNS
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    faces = []

    def add(points: Array, height: float, material: str) -> None:
        faces.append(_face(1e3 * plate.to_body(at_height(points, height) / 1e3) @ flat, material, fine=True))

    for dot in dots_of(plate.marker):
        add([dot.x, dot.y] + dot.radius * circle, dot.z, "dark")
        if dot.inner:
            add([dot.x, dot.y] + dot.inner * circle, dot.z, "light")
    if plate.marker.tag is not None:
        rings = [1e3 * plate.to_body(at_height(ring, 0.0)) @ flat for ring in plate.marker.tag.outlines]
        faces.append(ViewFace(tuple(map(polygon, rings)), "dark", fine=True))
    return faces


def _controls(side: BlockFace, datums: Sequence[BlockFace], accuracy: Accuracy) -> tuple[Control, ...]:
    """Form or orientation of a side of a body, and its place."""
    letters = LETTERS[: len(datums)]
    number = next((k for k, datum in enumerate(datums) if datum.name == side.name), None)
    zone = millimeters(accuracy.flatness)
    if number == 0:
        return (Control("flatness", zone),)
    orientation = Control(_kind(side, datums[0]), zone, ("R",))
    if number is not None:
        return (orientation,)
    return (orientation, Control("profile", millimeters(2 * accuracy.thickness), tuple(letters)))


def _kind(side: BlockFace, datum: BlockFace) -> Literal["parallelism", "perpendicularity", "angularity"]:
    along = abs(float(side.normal @ datum.normal))
    return "parallelism" if along > 1 - STRAIGHT else "perpendicularity" if along < STRAIGHT else "angularity"


def _face_table(rig: Rig) -> DrawingTable:
    """Where each marker is in the rig: its origin, and where its axes point."""
    rows = []
    for plate in rig.markers:
        axes = ["(" + ", ".join(exact(value, 6) for value in plate.rotation_matrix[:, k]) + ")" for k in range(3)]
        rows.append((plate.name, *(fixed(value) for value in 1e3 * plate.translation_vector), *axes))
    headings = ("face", "x", "y", "z", "its x axis (right)", "its y axis (up)", "its z axis (out)")
    title = "Faces in the rig frame: origins in mm, and axes as unit vectors, theoretically exact"
    return DrawingTable(title, headings, tuple(rows), (0,))


def _relation_tables(
    rig: Rig, made: MadeBody, sides: Sequence[BlockFace], datums: Sequence[BlockFace], accuracy: Accuracy
) -> list[DrawingTable]:
    """Datums of the whole, and the tolerances of its faces in words."""
    if not made.block:
        return []
    marked = {plate.name for plate in rig.markers}
    names = tuple(
        (letter, f"face {side.name}" if side.name in marked else "bare side", _plane(side))
        for letter, side in zip(LETTERS, datums, strict=False)
    )
    rows = []
    for side in sides:
        controls = _controls(side, datums, accuracy)
        angle = np.degrees(np.arccos(np.clip(side.normal @ datums[0].normal, -1, 1)))
        frames = [
            f"{control.symbol} {control.zone}{' to ' + ', '.join(control.datums) if control.datums else ''}"
            for control in controls
        ]
        first = frames[0] + (f", [{round(float(angle), 3):g}\xb0]" if "angularity" in frames[0] else "")
        dots = "on its sheet, to A, B, C" if side.name in marked else "-"
        rows.append(
            (
                side.name if side.name in marked else f"bare, {_plane(side)}",
                first,
                frames[1] if len(frames) > 1 else "datum",
                dots,
            )
        )
    return [
        DrawingTable("Datums of the whole", ("datum", "feature", "rig frame, exact"), names, (0, 1, 2)),
        DrawingTable(
            "Relation of the faces, mm",
            ("face", "form or orientation", "place", "positions of dots"),
            tuple(rows),
            (0, 1, 2, 3),
        ),
    ]


def _plane(side: BlockFace) -> str:
    """Equation of a side's plane."""
    level = float(side.normal @ side.ring().mean(axis=0))
    k = int(np.argmax(np.abs(side.normal)))
    if abs(side.normal[k]) > 1 - STRAIGHT:
        return f"{'xyz'[k]} = [{millimeters(level * np.sign(side.normal[k]))}]"
    terms = " ".join(
        f"{value:+.6g}{axis}" for value, axis in zip(side.normal, "xyz", strict=True) if abs(value) > STRAIGHT
    )
    return f"{terms} = [{millimeters(level)}]"


def _face_work(plate: Plate, made: MadeBody, k: int, fabrication: Fabrication) -> Workpiece:
    """Describe one face of a body as if it were a plate, with the body seen from the side."""
    face, result = made.block[k], made.made[k]
    slab = replace(made.parts[0].pieces[k].part, name="plate")
    outline = Polygon((tuple((x / 1e3, y / 1e3) for x, y in face.corners),))
    marker = replace(plate.marker, substrate=replace(plate.marker.substrate, outline=outline))
    work = workpiece(marker, fabrication, replace(result, parts=(slab, *result.parts)))
    depth = f"({millimeters(face.height - slab.add[0].span[0])})"
    sections = tuple(
        replace(
            section,
            title=f"{section.title}, upper part of the body",
            upright=tuple(dimension for dimension in section.upright if dimension.text != depth),
        )
        for section in work.sections
    )
    rotation = np.array(face.rotation)
    flat, toward = rotation[:, [0, 2]], -rotation[:, 1]
    offset = np.array(face.translation) @ flat
    side = tuple(_face(wall.ring() @ flat - offset) for wall in made.block if wall.normal @ toward > STRAIGHT)
    foot = min(face_.box[1] for face_ in side)
    tables = tuple(
        replace(table, rows=tuple(row for row in table.rows if "plate" not in (row[1], row[0].rpartition(" ")[2])))
        for table in work.tables
    )
    return replace(
        work,
        side=side,
        listed=True,
        sections=sections,
        tables=tables,
        parallelism=None,
        heights=(Dimension(foot, face.height, f"({millimeters(face.height - foot)})"),),
    )


PLACES = {"main": (0, 0), "+u": (-1, 0), "-u": (1, 0), "+v": (0, -1), "-v": (0, 1), "rear": (2, 0)}
"""Column and row of each view in first-angle projection, by the direction that it is seen from in the main view."""

SMALLEST = 12.0
"""Minimum size in mm on paper of the largest view."""

LEAST_GAP = 2.0
"""Minimum distance in mm, on A4, between columns of views; at 0 an upright size is drawn across the view beside it."""


def rig_page(work: RigWork, options: SheetOptions) -> FrontPage:
    """Draw the views on the first usual paper that shows them at 1 : 1 or more, or else at the largest scale.

    Raises
    ------
    InputError
        If the paper is unknown, or too small for any scale.
    """
    return best_on_paper(options, lambda frame, _: _page(work, frame), "the drawing of a rig", "A3 or larger")


def _page(work: RigWork, frame: Frame) -> FrontPage | None:
    """Draw at the largest scale that fits on a page; None if there is none."""
    style, (left, bottom, right, top) = Style(frame.scale), drawing_area(frame)
    for scale in SCALES:
        columns, rows = _grid(work, scale, style, first_angle(frame.paper))
        wide = sum(columns.values()) + LEAST_GAP * style.scale * (len(columns) + 1)
        if wide <= right - left and sum(rows.values()) <= top - bottom:
            return FrontPage(frame, scale, (0.0, 0.0), tuple(_draw(work, scale, frame)))
        boxes = [around(view.faces) for view in work.views]
        if max(scale * max(box[2] - box[0], box[3] - box[1]) for box in boxes) < SMALLEST:
            return None
    return None


def _place(view: RigView, first: bool) -> tuple[int, int]:
    column, row = PLACES[view.place]
    return (column, row) if first or column == 2 else (-column, -row)


def _named(name: FaceName, style: Style) -> float:
    frames = sum(frame_width(control, style.words) + 1.5 * style.scale for control in name.controls)
    return text_width(f"{name.text}  ", style.words) + frames + datum_reach(style.words) * bool(name.datum)


def _grid(work: RigWork, scale: float, style: Style, first: bool) -> tuple[dict[int, float], dict[int, float]]:
    """Widths of the columns and heights of the rows that have views, with the annotations around these."""
    columns: dict[int, float] = {}
    rows: dict[int, float] = {}
    side, above = _air(style)
    for view in work.views:
        column, row = _place(view, first)
        left, bottom, right, top = around(view.faces)
        heads = [text_width(view.text, style.words), *(_named(name, style) for name in view.names if name.controls)]
        columns[column] = max(columns.get(column, 0.0), max(scale * (right - left), *heads) + side)
        rows[row] = max(rows.get(row, 0.0), scale * (top - bottom) + above)
    return columns, rows


def _air(style: Style) -> tuple[float, float]:
    """Room beside each view for sizes, and above and below it together."""
    return 10.5 * style.scale, 26 * style.scale


def _draw(work: RigWork, scale: float, frame: Frame) -> list[Shape]:
    shapes: list[Shape] = []
    style, (left, bottom, right, top), first = Style(frame.scale), drawing_area(frame), first_angle(frame.paper)
    columns, rows = _grid(work, scale, style, first)
    spare = right - left - sum(columns.values()), top - bottom - sum(rows.values())
    gap = spare[0] / (len(columns) + 1), spare[1] / (len(rows) + 1)
    side, above = _air(style)
    starts, x = {}, left + gap[0]
    for column in sorted(columns):
        starts[column] = x
        x += columns[column] + gap[0]
    lows, y = {}, bottom + gap[1]
    for row in sorted(rows):
        lows[row] = y
        y += rows[row] + gap[1]
    for view in work.views:
        column, row = _place(view, first)
        box = around(view.faces)
        # Views of one row or column are aligned, by the frame of the rig.
        aside = max(columns[column] - side - scale * (box[2] - box[0]), 0) / 2 + side * 0.6
        view_at = DrawingView(starts[column] + aside - scale * box[0], lows[row] + above * 0.45 - scale * box[1], scale)
        shapes += _drawn_view(view, view_at, style)
        if view.place == "main":
            shapes += _sizes(work, view_at.box(box), style)
        elif view.place in ("+u", "-u") and not any(s.place == "+u" and view.place == "-u" for s in work.views):
            edges = view_at.box(box)
            below = edges[1] - 1.4 * CLOSE * style.scale
            shapes += across(edges[0], edges[2], below, edges[1], work.sizes[2], style)
    # The picture is to the right of the main column, above the main row, or else below it.
    aside, over = starts[0] + columns[0] + gap[0], lows[0] + rows[0] + gap[1]
    corner = (aside, over, right, top) if top - over >= 15 else (aside, bottom, right, lows[0] - gap[1])
    return [*shapes, *_drawn_picture(work, style, corner)]


def _drawn_view(view: RigView, at: DrawingView, style: Style) -> list[Shape]:
    """One view with its names, tolerances and datums."""
    shapes = [shape for face in view.faces for shape in drawn(face, at)]
    left, _, right, top = at.box(around(view.faces))
    # Above the arrow of the upright axis.
    height, line = style.words, top + (7.5 if view.place == "main" else 2.2) * style.scale
    for name in view.names:
        if not name.controls:
            continue
        # Above the view, with a leader that ends in the face.
        wide = _named(name, style)
        x = (left + right - wide) / 2
        shapes += [lettering(name.text, x, line + 0.5 * height, height, face="bold", name=f"face-{name.text}")]
        x += text_width(f"{name.text}  ", height)
        foot = x + 1.5 * style.scale
        for control in name.controls:
            shapes += tolerance_frame(control, x, line + 0.5 * height, height)
            x += frame_width(control, height) + 1.5 * style.scale
        if name.datum:
            # On the frame: the datum is the face that it is about.
            end = x - 1.5 * style.scale
            shapes += datum_letter(name.datum, (end, line + height), (1.0, 0.0), height)
        inside = max(min(foot, right - 1.5 * style.scale), left + 1.5 * style.scale), top - 1.5 * style.scale
        shapes += [Line(((foot, line), inside), THIN), *_spot(inside, style)]
        line += 2.4 * height
    shapes += [lettering(view.text, (left + right) / 2, line + 0.2 * height, height, "center", color=GRAY)]
    if view.place == "main":
        shapes += _axes(view, at, style)
    return shapes + _on_faces([name for name in view.names if not name.controls], at, style)


def _on_faces(names: Sequence[FaceName], at: DrawingView, style: Style) -> list[Shape]:
    """Names in the middle of faces that are wide enough for them."""
    shapes: list[Shape] = []
    for name in names:
        height = style.words
        if text_width(name.text, height, "bold") < at.scale * name.width:
            x, y = at.at(name.at)
            shapes += on_white(lettering(name.text, x, y - height / 2, height, "center", face="bold"))
    return shapes


def _spot(at: Point, style: Style) -> list[Shape]:
    """End of a leader within a face."""
    half = 0.35 * style.scale
    corners = ((at[0] - half, at[1]), (at[0], at[1] - half), (at[0] + half, at[1]), (at[0], at[1] + half))
    return [closed_line(corners, 2 * THIN)]


def _axes(view: RigView, at: DrawingView, style: Style) -> list[Shape]:
    """Axes of the rig frame, whose positive ends have arrows."""
    left, bottom, right, top = at.box(around(view.faces))
    x, y = at.at((0.0, 0.0))
    over = 4.0 * style.scale
    ends = {"+": (right + over, top + over), "-": (left - over, bottom - over)}
    shapes: list[Shape] = [
        *center_line((min(left, x) - over, y), (max(right, x) + over, y), style),
        *center_line((x, min(bottom, y) - over), (x, max(top, y) + over), style),
    ]
    for k, axis in enumerate(view.axes):
        sign, name = ("-", axis[1:]) if axis.startswith("-") else ("+", axis)
        end = ends[sign][k]
        tip, way = ((end, y), (1.0, 0.0)) if k == 0 else ((x, end), (0.0, 1.0))
        if sign == "-":
            way = (-way[0], -way[1])
        shapes.append(arrow(tip, way, style))
        off = (way[0] * 1.6 * style.scale + way[1] * 1.8 * style.scale, way[1] * -0.2 * style.scale + abs(way[0]) * 1.2)
        shapes.append(lettering(name, tip[0] + off[0], tip[1] + off[1], style.words, "center", name=f"axis-{name}"))
    return shapes


def _sizes(work: RigWork, box: Box, style: Style) -> list[Shape]:
    """Overall width and height of the main view."""
    left, bottom, right, top = box
    off = 1.4 * CLOSE * style.scale
    return [
        *across(left, right, bottom - off, bottom, work.sizes[0], style),
        *vertical_dimension(bottom, top, left - off, left, work.sizes[1], style),
    ]


def _drawn_picture(work: RigWork, style: Style, room: Box) -> list[Shape]:
    """The whole from a corner, as large as there is room, not to scale."""
    left, bottom, right, top = room
    box = around(work.picture.faces)
    caption = 3.5 * style.scale
    scale = min((right - left) / (box[2] - box[0]), (top - bottom - caption) / (box[3] - box[1])) * 0.86
    if scale * max(box[2] - box[0], box[3] - box[1]) < SMALLEST:
        return []
    x = (left + right - scale * (box[0] + box[2])) / 2
    view = DrawingView(x, bottom + caption + (top - bottom - caption - scale * (box[1] + box[3])) / 2, scale)
    shapes = [shape for face in work.picture.faces for shape in drawn(face, view)]
    shapes += _on_faces(work.picture.names, view, style)
    low = view.at((0.0, box[1]))[1]
    middle = min((left + right) / 2, right - text_width(work.picture.text, style.words) / 2)
    below = lettering(work.picture.text, middle, low - caption, style.words, "center", color=GRAY)
    return [*shapes, below]
