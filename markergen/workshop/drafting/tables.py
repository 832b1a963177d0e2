"""Tables of the fabrication drawing: dots, holes, outline, tag, pillars and parts as rows of text."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import atan2, degrees, tan

from markergen.geometry.contour import Contour, box, radius_of
from markergen.model.marker import Marker
from markergen.solid.plate import plate_of
from markergen.solid.primitives import SAME, Part, Primitive, Prism, Revolved, mm, size_of
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.drafting.drawing import DrawingTable, millimeters
from markergen.workshop.drafting.sections import centered, recesses_of, use_words
from markergen.workshop.drafting.tolerances import (
    DIAMETER,
    cutouts_of,
    holes_of,
    is_rectangle,
)
from markergen.workshop.processes import Made

MOST_CORNERS = 40
"""Maximum number of corners of an outline that are listed; the solid has more."""


def tables_of(marker: Marker, made: Made) -> tuple[DrawingTable, ...]:
    """Tables of control points, any holes, cut-outs, outline, pillars, the tag's corners, and parts."""
    points = DrawingTable(
        "Centers of the dots, mm, theoretically exact",
        ("id", "x", "y", "z", "diameter", "inner"),
        tuple(
            (
                str(p.id),
                *(_fixed(mm(value)) for value in (p.x, p.y, p.z)),
                millimeters(mm(p.feature.diameter)),
                millimeters(mm(p.feature.inner_diameter)) if p.feature.inner_diameter else "-",
            )
            for p in marker.control_points
        ),
    )
    tables = [points]
    if holes := holes_of(marker):
        rows = tuple(
            (
                hole.label,
                _fixed(hole.x),
                _fixed(hole.y),
                f"{DIAMETER}{millimeters(2 * hole.radius)}" + (f" {hole.limits.name}" if hole.limits else ""),
                millimeters(2 * hole.sink) if hole.sink else "-",
                use_words(hole),
            )
            for hole in holes
        )
        tables.append(
            DrawingTable(
                "Holes through the plate, mm; x, y theoretically exact",
                ("hole", "x", "y", "diameter", "countersink", "use"),
                rows,
                (0, 3, 5),
            )
        )
    tables += _outlines(marker, made)
    if pillars := _pillars(marker, made.add):
        headings = ("under dots", "height above A", "top", "base", "draft", "fillet")
        tables.append(DrawingTable("Pillars, mm: diameters without the fillet", headings, pillars, (0,)))
    if marker.tag:
        names = ("top left", "top right", "bottom right", "bottom left")
        places = marker.tag.corners.tolist()
        corners = tuple((name, _fixed(mm(x)), _fixed(mm(y))) for name, (x, y) in zip(names, places, strict=True))
        tables.append(
            DrawingTable(f"Corners of the black square of {marker.tag}, mm", ("corner", "x", "y"), corners, (0,))
        )
    return (*tables, _part_list(made.parts))


@dataclass(frozen=True)
class ListedOutline:
    """Outline that a table describes: title of the table, words of the callout, and whose it is."""

    title: str
    words: str
    contour: Contour
    plate: bool = False
    recess: Prism | None = None


def is_plain(recess: Prism) -> bool:
    """True for a recess that a diameter, or width and height, and a place describe."""
    return recess.outer.as_circle is not None or is_rectangle(recess.outer)


def listed_outlines(marker: Marker, made: Made) -> list[ListedOutline]:
    """Outlines that a size and a radius do not describe: of plates, of holes that are not round, and of recesses."""
    plates = [outer for outer, *_ in plate_of(marker).outlines]
    found = []
    if len(plates) > 1:
        for number, outer in enumerate(plates, 1):
            found.append(ListedOutline(f"Outline of plate {number}", f"plate {number}, all around", outer, True))
    elif plates[0].as_circle is None and not is_rectangle(plates[0]):
        found.append(ListedOutline("Outline of the plate", "outline, all around", plates[0], True))
    for number, contour in enumerate(cutouts_of(marker), 1):
        found.append(ListedOutline(f"Cut-out S{number}", f"cut-out S{number}, through", contour))
    for number, recess in enumerate(recesses_of(made), 1):
        if not is_plain(recess):
            found.append(ListedOutline(f"Recess {number}", f"recess {number}", recess.outer, recess=recess))
    return found


def _outlines(marker: Marker, made: Made) -> list[DrawingTable]:
    """Corners of outlines, or the center of a round one."""
    tables = []
    for each in listed_outlines(marker, made):
        title, contour = each.title, each.contour
        if circle := contour.as_circle:
            x, y, radius = circle
            row = _fixed(x), _fixed(y), f"{DIAMETER}{millimeters(2 * radius)}"
            tables.append(DrawingTable(f"{title}, mm", ("center x", "center y", "diameter"), (row,)))
            continue
        left, bottom, right, top = box(contour)
        size = f"{millimeters(right - left)} x {millimeters(top - bottom)} mm"
        if len(contour.points) > MOST_CORNERS:
            words = ((f"{len(contour.points)} corners", "as in the STEP file"),)
            tables.append(DrawingTable(f"{title}, {size}", ("what", "where"), words, (0, 1)))
        else:
            tables.append(
                DrawingTable(f"{title}, {size}", ("corner x", "corner y", "to the next"), _corners(contour), (2,))
            )
    return tables


def _corners(contour: Contour) -> tuple[tuple[str, ...], ...]:
    def side(bulge: float, radius: float) -> str:
        return f"arc R{millimeters(radius)} to the {'left' if bulge > 0 else 'right'}" if bulge else "line"

    return tuple((_fixed(a[0]), _fixed(a[1]), side(bulge, radius_of((a, b, bulge)))) for a, b, bulge in contour.sides)


def _pillars(marker: Marker, added: Sequence[Primitive]) -> tuple[tuple[str, ...], ...]:
    """Rows of pillars of the same shape."""
    groups: dict[tuple[str, ...], list[int]] = {}
    for dot in dots_of(marker):
        for body in centered(added, dot.x, dot.y):
            sides = body.profile.sides
            (r, z), (u, w), _ = next(side for side in sides if side[1] == body.profile.points[-2])
            draft = atan2(r - u, w - z)
            fillet = next((radius_of(side) for side in sides if side[2]), 0.0)
            sizes = millimeters(w), millimeters(2 * u), millimeters(2 * (u + w * tan(draft)))
            shape = (*(sizes[0], *(f"{DIAMETER}{size}" for size in sizes[1:])), f"{round(degrees(draft), 3) + 0:g}\xb0")
            groups.setdefault((*shape, f"R{millimeters(fillet)}" if fillet else "-"), []).append(dot.id)
    return tuple((ranges(ids), *shape) for shape, ids in groups.items())


def _part_list(parts: Sequence[Part]) -> DrawingTable:
    groups: dict[tuple[str, str, str], list[str]] = {}
    for part in parts:
        key = part.material, _size(part), f"{part.volume / 1e3:.3f}"
        groups.setdefault(key, []).append(part.name)
    rows = tuple(
        (str(len(names)), _names(names), material, size, volume) for (material, size, volume), names in groups.items()
    )
    return DrawingTable("Parts", ("pieces", "name", "color", "size, mm", "volume each, cm\xb3"), rows, (1, 2, 3))


def _size(part: Part) -> str:
    """Diameters and height of a round part; width, height and thickness of others."""
    low, high = part.span
    if len(part.add) == 1 and isinstance(part.add[0], Revolved):
        least, most = part.add[0].radii
        inner = f" / {DIAMETER}{millimeters(2 * least)}" if least > SAME else ""
        return f"{DIAMETER}{millimeters(2 * most)}{inner} x {millimeters(high - low)}"
    width, height = size_of(part.add)
    if part.is_disk:
        return f"{DIAMETER}{millimeters(width)} x {millimeters(high - low)}"
    return f"{millimeters(width)} x {millimeters(height)} x {millimeters(high - low)}"


def _names(names: Sequence[str]) -> str:
    """Abbreviate long lists of part names: ``dot-1, dot-3 to dot-5``."""
    stems: dict[tuple[str, str], list[int]] = {}
    words = []
    for name in names:
        stem, _, rest = name.partition("-")
        number, _, suffix = rest.partition("-")
        if number.isdecimal():
            stems.setdefault((stem, suffix), []).append(int(number))
        else:
            words.append(name)
    for (stem, suffix), numbers in stems.items():
        words.append(f"{stem}-{ranges(numbers)}" + (f" {suffix}" if suffix else ""))
    return ", ".join(words)


def ranges(numbers: Iterable[int]) -> str:
    """Abbreviate a list of integers: ``1 to 4, 7``."""
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    words: list[str] = []
    for run in runs:
        words += [str(run[0])] if len(run) == 1 else [f"{run[0]} to {run[-1]}"] if len(run) > 2 else map(str, run)
    return ", ".join(words)


def _fixed(millimeters_: float) -> str:
    # Adding 0 turns -0 into 0.
    return f"{round(millimeters_, 4) + 0.0:.4f}"
