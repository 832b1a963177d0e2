"""Read lines, arcs, polylines with bulges, ellipses and splines of a DXF's model space, through blocks."""

import io
import logging
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief, reason_of
from markergen.geometry.contour import Contour, placed
from markergen.read.outlines.curves import Arc, Curve, Polyline, Spline, bulge
from markergen.read.outlines.formats import (
    MOST_PIECES,
    OUTLINE_FORMATS,
    Drawing,
    OutlineFile,
    OutlineFormat,
    OutlinePiece,
)

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document


LARGEST_DXF = 2_000_000
"""Maximum size in bytes; ezdxf takes a second or more per million."""
MOST_RECORDS = 20_000
"""Maximum number of entities, blocks and entries of tables and dictionaries; ezdxf makes an object of each."""
DEEPEST = 20
"""Maximum nesting of blocks."""

SCALES = {
    1: 0.0254, 2: 0.3048, 3: 1609.344, 4: 1e-3, 5: 1e-2, 6: 1.0, 7: 1e3, 8: 2.54e-8, 9: 2.54e-5, 10: 0.9144,
    11: 1e-10, 12: 1e-9, 13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0, 21: 1200 / 3937, 22: 100 / 3937, 23: 3600 / 3937,
}  # fmt: skip
"""Units of $INSUNITS in m; 0 is unitless, and those omitted are astronomical."""

IRRELEVANT = ("TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "ARC_DIMENSION", "LEADER", "MULTILEADER", "TOLERANCE",
              "POINT", "VIEWPORT")  # fmt: skip
"""Kinds of entities that annotate a drawing, and are no part of its shapes."""
ELSEWHERE = "shapes on other layers"
CENTER_LINES = "center lines"
_CENTER_LINETYPE = re.compile(r"cent(er|re)", re.IGNORECASE)
_CENTER_LAYER = re.compile(
    r"(cent(er|re)|construction|mittellinie|konstruktion|axis)([ _-]?(line|mark|geometry))?(n|s|en)?", re.IGNORECASE
)
"""Linetypes, and whole names of layers, of lines that show where an axis is, and are no part of a shape."""

Parts = tuple[list[Curve], bool]
"""Consecutive curves, perhaps none, and whether the last is joined to the first."""

HIGHEST_DEGREE = 11
"""Maximum degree of a spline; CAD programs write 3, and seldom more."""
MOST_FIT_POINTS = 500
"""Maximum number of fit points of a spline: ezdxf solves a full matrix, which takes 2 GB and 30 s for 10,000."""

BINARY = b"AutoCAD Binary DXF\r\n\x1a\x00"
"""What a binary file begins with."""

# ezdxf logs its repairs, and without a handler Python would print them to standard error.
logging.getLogger("ezdxf").addHandler(logging.NullHandler())

_END = re.compile(r"^[ \t]*0[ \t]*\n[ \t]*EOF(?=\s|\x1a|$)", re.MULTILINE)
_ENTITIES = re.compile(r"^[ \t]*2[ \t]*\n[ \t]*ENTITIES[ \t]*$", re.MULTILINE)


@contextmanager
def without_time() -> Iterator[None]:
    """Make ezdxf write fixed dates and identifiers instead of the current time and random ones."""
    import ezdxf

    options = vars(ezdxf)["options"]
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before


def _fits(file: OutlineFile) -> bool:
    # The first group code: 0 for a section, or 999 for a comment.
    first = file.data.removeprefix(b"\xef\xbb\xbf").lstrip()[:100].replace(b"\r", b"\n").split(b"\n")[0].strip()
    return first in (b"0", b"999") or file.data.startswith(BINARY)


def _read(file: OutlineFile, layer: str | None) -> Drawing:
    """Drawing of all flat entities in the model space."""
    reader = DxfReader(file, layer.casefold() if layer is not None else None)
    document = reader.document
    names = {entry.dxf.name.casefold(): str(entry.dxf.name) for entry in document.layers}
    pieces: list[tuple[str, list[Curve], bool]] = []
    with _undamaged(file):
        for entity in reader.entities():
            if not reader.chosen(entity):
                reader.others.append("hidden shapes" if layer is None else ELSEWHERE)
            elif reader.is_center_line(entity):
                reader.others.append(CENTER_LINES)
            elif entity.kind in CURVES:
                pieces += [(entity.name, *curves) for curves in entity.curves(file)]
            else:
                reader.others.append(entity.kind)
        sheets = [layout for layout in document.layouts if layout.is_any_paperspace]
        if any(entity.dxftype() not in IRRELEVANT for sheet in sheets for entity in sheet):
            reader.others.append("shapes in paper space")
    names |= {name.casefold(): name for name in reader.layers if name.casefold() not in names}
    if layer is not None and layer.casefold() not in names:
        raise file.unknown_layer(layer, sorted(names.values()))
    points = np.concatenate([curve.sketch() for _, curves, _ in pieces for curve in curves] or [np.zeros((1, 3))])
    # Infinite and nan coordinates are reported later, with the piece's name.
    if np.isfinite(points).all() and np.ptp(points[:, 2]) > 1e-6 * np.ptp(points, axis=0).max():
        low, high = points[:, 2].min(), points[:, 2].max()
        remedy = "draw it in one plane, or choose its --layer"
        raise file.unreadable("a flat outline", f"heights z from {low:.6g} to {high:.6g}", remedy)
    flat = [
        OutlinePiece(name, tuple(curve.mapped(np.eye(4)[:2]) for curve in curves), closed)
        for name, curves, closed in pieces
    ]
    # ezdxf assumes a unit if there is none.
    unit = document.header.get("$INSUNITS", 0) if b"$INSUNITS" in file.data else 0
    others = [kind for kind in reader.others if flat == [] or kind not in (*IRRELEVANT, ELSEWHERE)]
    return Drawing(flat, SCALES.get(unit), others=others)


@contextmanager
def _undamaged(file: OutlineFile) -> Iterator[None]:
    """Report the undocumented errors that ezdxf raises on damaged values as one line."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        raise file.damaged("an undamaged drawing", _reason(error)) from None


class PlacedEntity(NamedTuple):
    """An entity where blocks put it.

    Attributes
    ----------
    frame : array (3, 4)
        From its coordinates to the drawing's.
    """

    entity: Any
    layer: str
    frame: Array

    @property
    def kind(self) -> str:
        """Its type in the file."""
        return str(self.entity.dxftype())

    @property
    def name(self) -> str:
        """Name that the user recognizes."""
        return f"{self.kind} on layer {brief(self.layer)}"

    def curves(self, file: OutlineFile) -> Iterator[Parts]:
        """Yield its curves in the drawing, if it is one of `CURVES`."""
        with _undamaged(file):
            curves, closed = CURVES[self.kind](self.entity, file, self.name)
            if curves:
                yield [curve.mapped(self.frame) for curve in curves], closed


@dataclass
class DxfReader:
    """Reader of a document's entities; with a wanted layer those of hidden blocks, too."""

    file: OutlineFile
    wanted: str | None = None
    others: list[str] = field(default_factory=list)
    layers: dict[str, None] = field(default_factory=dict)
    steps: int = 0

    def __post_init__(self) -> None:
        self.document = _document(self.file)

    def entities(self) -> Iterator[PlacedEntity]:
        """Entities of the model space, through blocks."""
        with _undamaged(self.file):
            yield from self._of_block(self.document.modelspace(), np.eye(4), "0", ())

    def _of_block(
        self, entities: Iterable[Any], matrix: Array, outer: str, blocks: tuple[str, ...]
    ) -> Iterator[PlacedEntity]:
        """Entities of a block whose coordinates `matrix` (4, 4) maps to the model's; `outer` is its layer."""
        for entity in entities:
            self._step()
            # Entities on layer 0 of a block take the layer of its INSERT.
            layer = str(entity.dxf.get("layer", "0"))
            layer = outer if blocks and layer == "0" else layer
            self.layers[layer] = None
            if entity.dxftype() != "INSERT":
                yield PlacedEntity(entity, layer, (matrix @ coordinate_system_of(entity))[:3])
            elif self._visible(entity, layer):
                yield from self._insert(entity, matrix, layer, blocks)
            else:
                self.others.append("hidden shapes")

    def _insert(self, insert: Any, matrix: Array, layer: str, blocks: tuple[str, ...]) -> Iterator[PlacedEntity]:
        block = insert.block()
        name = str(insert.dxf.get("name", ""))
        if block is None:
            raise self.file.unreadable("all blocks", f"an INSERT of {brief(name)}, which is missing", "write it again")
        if block.block is not None and block.block.is_xref:
            expected = "no references to other files"
            raise self.file.unreadable(expected, f"the block {brief(name)}", "bind it, or remove it")
        if name in blocks or len(blocks) >= DEEPEST:
            problem = f"the block {brief(name)} inside itself or deeper"
            raise self.file.unreadable(f"blocks at most {DEEPEST} deep", problem, "explode the blocks")
        for copy in self._copies(insert):
            # ezdxf multiplies rows from the left, so its matrices are transposed.
            placed = np.array(list(copy.matrix44()), dtype=float).reshape(4, 4).T
            yield from self._of_block(block, matrix @ placed, layer, (*blocks, name))

    def _copies(self, insert: Any) -> Iterator[Any]:
        rows, columns = int(insert.dxf.get("row_count", 1)), int(insert.dxf.get("column_count", 1))
        if max(rows, 1) * max(columns, 1) > MOST_PIECES:
            raise self.file.too_much(f"at most {MOST_PIECES} copies of a block")
        if rows <= 1 and columns <= 1:
            yield insert
            return
        # A grid has at least one row and one column.
        insert = insert.copy()
        insert.dxf.row_count, insert.dxf.column_count = max(rows, 1), max(columns, 1)
        for copy in insert.multi_insert():
            self._step()
            yield copy

    def chosen(self, placed: PlacedEntity) -> bool:
        """Tell whether an entity is on the wanted layer or, without one, visible."""
        if self.wanted is not None:
            return placed.layer.casefold() == self.wanted
        return self._visible(placed.entity, placed.layer)

    def is_center_line(self, placed: PlacedEntity) -> bool:
        """Tell whether an entity is a center line by its linetype, or by a layer that was not asked for."""
        linetype = str(placed.entity.dxf.get("linetype", "BYLAYER"))
        if linetype.upper() == "BYLAYER" and placed.layer in self.document.layers:
            linetype = str(self.document.layers.get(placed.layer).dxf.get("linetype", ""))
        on_such_layer = self.wanted is None and _CENTER_LAYER.fullmatch(placed.layer.strip())
        return bool(_CENTER_LINETYPE.match(linetype) or on_such_layer)

    def _visible(self, entity: Any, layer: str) -> bool:
        """Tell whether an entity is visible; an INSERT on a hidden layer may contain entities of the wanted layer."""
        if self.wanted is not None:
            return True
        # A layer without an entry in the table is on.
        if entity.dxf.get("invisible", 0) or layer not in self.document.layers:
            return not entity.dxf.get("invisible", 0)
        entry = self.document.layers.get(layer)
        return not (entry.is_off() or entry.is_frozen())

    def _step(self) -> None:
        self.steps += 1
        if self.steps > MOST_PIECES:
            raise self.file.too_much(f"at most {MOST_PIECES} lines, arcs and copies of blocks")


def _document(file: OutlineFile) -> "Document":
    """Parse the file after checking that it is complete text."""
    if len(file.data) > LARGEST_DXF:
        raise file.too_much(f"at most {LARGEST_DXF // 10**6} MB of DXF")
    text = _whole(_text(file).lstrip("\n"), file)
    # A group is two lines, a code and a value; code 0 starts a record.
    # Counted before parsing, which makes an object of each.
    if sum(line.strip() == "0" for line in text.splitlines()[::2]) > MOST_RECORDS:
        raise file.too_much(f"at most {MOST_RECORDS} entities and other records")
    import ezdxf

    try:
        return ezdxf.read(io.StringIO(text))  # type: ignore[attr-defined]
    except ezdxf.DXFVersionError as error:  # type: ignore[attr-defined]
        raise file.unreadable("DXF of R12 or later", reason_of(error), "save it in a later version") from None
    except Exception as error:  # Damaged files also raise errors that are not ezdxf's own.
        return _repaired(text, file, error)


def _whole(text: str, file: OutlineFile) -> str:
    """Text up to its end mark, 0 EOF, which some programs follow with other characters, and some omit."""
    if "\0" in text:
        raise file.damaged("DXF", "null characters")
    if end := _END.search(text):
        return text[: end.end()] + "\n"
    last = text[-4096:].split()
    if last[-2:] == ["0", "ENDSEC"] and _ENTITIES.search(text):
        return f"{text.rstrip()}\n0\nEOF\n"
    raise file.damaged("DXF to its end, 0 EOF,", f"{brief(' '.join(last[-2:]))} at the end")


def _repaired(text: str, file: OutlineFile, error: Exception) -> "Document":
    """Read a file that violates the format in ways that lose no curve, such as odd handles; else refuse it."""
    from ezdxf import recover

    # Errors about a line are about its value, which recovery would replace by a default.
    if re.search(r"\bline:? \d", str(error)):
        raise file.damaged("DXF", _reason(error)) from None
    try:
        document, audit = recover.read(io.BytesIO(text.encode("utf-8")))
    except Exception:  # As above.
        raise file.damaged("DXF", _reason(error)) from None
    # Repairs may drop entities.
    lines = [line.strip() for line in text.splitlines()]
    written = Counter(value for code, value in zip(lines[::2], lines[1::2], strict=False) if code == "0")
    counts = Counter(entity.dxftype() for entity in document.entitydb.values())
    if audit.errors or any(written[kind] != counts[kind] for kind in (*CURVES, "VERTEX", "INSERT")):
        raise file.damaged("DXF", _reason(error))
    return document


def _reason(error: Exception) -> str:
    """Message of an ezdxf error; errors from its internals mean nothing to users."""
    from ezdxf import DXFError  # type: ignore[attr-defined]

    text = " ".join(str(error).split()) if isinstance(error, DXFError) else ""
    return text if 3 < len(text) <= 120 and text.isprintable() else "invalid values"


def _unpacked(file: OutlineFile) -> str:
    """Text of a binary file."""
    from ezdxf.lldxf.tagger import binary_tags_loader

    try:
        return "".join(tag.dxfstr() for tag in binary_tags_loader(file.data, errors="ignore"))
    except Exception as error:  # As of damaged text.
        raise file.damaged("DXF", _reason(error)) from None


def _text(file: OutlineFile) -> str:
    """Text in the code page of the file; DXF is UTF-8 since 2007."""
    if file.data.startswith(BINARY):
        return _unpacked(file)
    # ezdxf takes a carriage return as part of the value.
    data = file.data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        from ezdxf.tools.codepage import toencoding

        match = re.search(rb"\$DWGCODEPAGE\s+3\s+(\w+)", data[:100_000])
        return data.decode(toencoding(match[1].decode("ascii", "replace")) if match else "cp1252", "replace")


def coordinate_system_of(entity: Any) -> Array:
    """Map (4, 4) from an entity's coordinates to the drawing's; only some kinds have an object coordinate system."""
    matrix = np.eye(4)
    kind = entity.dxftype()
    if kind in ("ARC", "CIRCLE", "LWPOLYLINE") or (kind == "POLYLINE" and entity.is_2d_polyline):
        matrix[:3, :3] = np.array(list(map(tuple, (entity.ocs().ux, entity.ocs().uy, entity.ocs().uz)))).T
    return matrix


def _line(entity: Any, *_: object) -> Parts:
    return [Polyline(np.array([entity.dxf.start, entity.dxf.end], dtype=float))], False


def _arc(entity: Any, file: OutlineFile, name: str) -> Parts:
    # ezdxf assumes a radius of 1 where the file has none.
    if not entity.dxf.hasattr("radius") or entity.dxf.radius < 0:
        stated = f"{entity.dxf.radius:g}" if entity.dxf.hasattr("radius") else "none"
        raise file.unreadable("a radius above 0", f"{stated} for {name}", "correct it, or remove it")
    center, (u, v, _) = np.array(entity.dxf.center, dtype=float), float(entity.dxf.radius) * np.eye(3)
    if entity.dxftype() == "CIRCLE":
        return [Arc(center, u, v)], True
    start, end = np.radians(float(entity.dxf.start_angle)), np.radians(float(entity.dxf.end_angle))
    return [Arc(center, u, v, float(start), _angle_between(start, end))], False


def _ellipse(entity: Any, *_: object) -> Parts:
    u = np.array(entity.dxf.major_axis, dtype=float)
    normal = np.array(entity.dxf.extrusion, dtype=float)
    # A DXF gives the major axis, and the minor one as a ratio of it.
    v = np.cross(normal / np.linalg.norm(normal), u) * float(entity.dxf.ratio)
    start, end = float(entity.dxf.start_param), float(entity.dxf.end_param)
    angle = _angle_between(start, end)
    # A full ellipse is written as 0 to 2 pi, with varying precision.
    whole = abs(angle - 2 * np.pi) < 1e-6
    return [Arc(np.array(entity.dxf.center, dtype=float), u, v, start, 2 * np.pi if whole else angle)], whole


def _lwpolyline(entity: Any, file: OutlineFile, _: str) -> Parts:
    rows = np.array(list(entity.get_points("xyb")), dtype=float).reshape(-1, 3)
    return _bulged(rows, float(entity.dxf.elevation), bool(entity.closed), file)


def _polyline(entity: Any, file: OutlineFile, name: str) -> Parts:
    if entity.is_poly_face_mesh or entity.is_polygon_mesh:
        raise file.unreadable("a flat outline", f"a mesh as {name}", "draw its outline, or choose another --layer")
    # Skip control vertices of a curve (flag 16), which the other vertices approximate.
    vertices = [vertex for vertex in entity.vertices if not int(vertex.dxf.flags) & 16]
    points = np.array([vertex.dxf.location for vertex in vertices], dtype=float).reshape(-1, 3)
    if not len(points) or not entity.is_2d_polyline:
        return [Polyline(points)] if len(points) else [], bool(entity.is_closed)
    bulges = [float(vertex.dxf.get("bulge", 0.0)) for vertex in vertices]
    height = float(entity.dxf.elevation[2]) if entity.dxf.hasattr("elevation") else 0.0
    return _bulged(np.column_stack([points[:, :2], bulges]), height, bool(entity.is_closed), file)


def _spline(entity: Any, file: OutlineFile, name: str) -> Parts:
    count = max(entity.control_point_count(), entity.fit_point_count(), entity.knot_count())
    if count > MOST_PIECES:
        raise file.too_much(f"splines of at most {MOST_PIECES} points")
    if entity.control_point_count():
        points = np.array(list(entity.control_points), dtype=float).reshape(-1, 3)
        knots = np.array(list(entity.knots), dtype=float)
        weights = np.array(list(entity.weights), dtype=float)
        degree = int(entity.dxf.degree)
    else:  # Only points on the curve: interpolate them as AutoCAD does.
        if count > MOST_FIT_POINTS:
            raise file.too_much(f"splines through at most {MOST_FIT_POINTS} points")
        tool = entity.construction_tool()
        points = np.array(list(tool.control_points), dtype=float).reshape(-1, 3)
        knots, weights, degree = np.array(tool.knots(), dtype=float), np.empty(0), int(tool.degree)
    weights = weights if len(weights) else np.ones(len(points))
    sound = (
        1 <= degree <= HIGHEST_DEGREE
        and len(points) > degree
        and len(knots) == len(points) + degree + 1
        and len(weights) == len(points)
        and all(np.isfinite(array).all() for array in (points, knots, weights))
        and bool((np.diff(knots) >= 0).all())
        and knots[degree] < knots[len(points)]
        and bool((weights > 0).all())
    )
    if not sound:
        problem = f"a degree above {HIGHEST_DEGREE}, or inconsistent points, knots and weights in {name}"
        raise file.unreadable("a valid spline", problem, "write it again")
    return [Spline(points, weights, knots, degree)], False


def _bulged(rows: Array, height: float, closed: bool, file: OutlineFile) -> Parts:
    """Curves in space through vertices (x, y, bulge), where a bulge applies to the segment that follows."""
    if len(rows) > MOST_PIECES:
        raise file.too_much(f"polylines of at most {MOST_PIECES} points")
    # Affine map of the plane to the elevation of the polyline.
    lift = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, height]])
    if not rows[:, 2].any():
        return [Polyline(rows[:, :2]).mapped(lift)], closed
    # The bulge of the last vertex of an open polyline means nothing.
    ends = np.roll(rows, -1, axis=0) if closed else rows[1:]
    steps = zip(rows[: len(ends)], ends, strict=True)
    return [bulge(start[:2], end[:2], float(start[2])).mapped(lift) for start, end in steps], closed


def _angle_between(start: float, end: float) -> float:
    """Angle from start to end, counterclockwise, above 0 and at most a full turn."""
    # Written so that equal angles give a full turn, as an arc of a DXF has them.
    return float(2 * np.pi - (start - end) % (2 * np.pi))


CURVES: dict[str, Callable[[Any, OutlineFile, str], Parts]] = {
    "LINE": _line,
    "CIRCLE": _arc,
    "ARC": _arc,
    "ELLIPSE": _ellipse,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "SPLINE": _spline,
}
"""Functions that make curves, by entity type; other types are not outlines."""


def as_circle(contour: Contour) -> tuple[float, float, float] | None:
    """Center and radius of a contour of two semicircles: sums of whole picometers, and their halves, are exact."""
    x, y, radius = (round(value, 11) for value in contour.as_circle or (0.0, 0.0, 0.0))
    return (x, y, radius) if radius else None


def add_contour(space: Any, contour: Contour, attributes: Mapping[str, str]) -> None:
    """Add a contour to the entities of a drawing, as a circle or a polyline with bulges."""
    if (disk := as_circle(contour)) is not None:
        space.add_circle(disk[:2], disk[2], dxfattribs=attributes)
        return
    rows = [(*corner, bulge) for corner, _, bulge in contour.sides]
    space.add_lwpolyline(rows, format="xyb", close=True, dxfattribs=attributes)


def _write(contours: Sequence[Contour], _: str) -> str:
    import ezdxf

    with without_time():
        document = ezdxf.new("R2010", units=4)  # type: ignore[attr-defined]
        for contour in contours:
            add_contour(document.modelspace(), placed(contour, 1000.0, (0.0, 0.0), 9), {})
        stream = io.StringIO()
        document.write(stream)
        return stream.getvalue()


OUTLINE_FORMATS.register("dxf")(
    OutlineFormat("groups that start with 0 SECTION, as text or binary", _fits, _read, (".dxf",), _write)
)
