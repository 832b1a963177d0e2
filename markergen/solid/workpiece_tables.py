"""Tables of a fabrication sheet: control points, holes, corners of the tag, parts and tolerances."""

from collections.abc import Iterable, Sequence

from markergen.drawing.workshop import Table
from markergen.drawing.workshop_front import millimeters
from markergen.geometry.contour import Contour, area, placed
from markergen.model.marker import Marker
from markergen.model.substrate import Hole
from markergen.solid.bodies import SAME, Part, Revolved, mm
from markergen.solid.processes import Made
from markergen.solid.sections import reach, size_of, widest

DIAMETER = "\xd8"

DRAWN = "in the outline"
"""What a hole is for that came with the outline from a drawing."""

LONGEST_NAME = 24
"""Characters of what goes through a hole."""

MOST_KINDS = 6
"""Of dots and of holes that are named in the drawing and cut; of more the tables tell."""


def tables_of(marker: Marker, made: Made) -> tuple[Table, ...]:
    """All tables; that of the control points comes first, then that of the holes if there are any."""
    points = Table(
        "Control points: centers of the dots, mm",
        ("id", "x", "y", "z", "diameter", "inner"),
        tuple(
            (
                str(p.id),
                *(_fixed(value) for value in (p.x, p.y, p.z)),
                millimeters(mm(p.feature.diameter)),
                millimeters(mm(p.feature.inner_diameter)) if p.feature.inner_diameter else "-",
            )
            for p in marker.control_points
        ),
    )
    tables = [points]
    drawn = drawn_holes(marker)
    if marker.substrate.holes or drawn:
        rows = tuple(
            (
                _fixed(hole.x),
                _fixed(hole.y),
                millimeters(mm(hole.diameter)),
                millimeters(mm(hole.sink)) if hole.sink else "-",
                use_words(hole),
            )
            for hole in marker.substrate.holes
        )
        rows += tuple((f"{x:.4f}", f"{y:.4f}", millimeters(2 * r), "-", DRAWN) for x, y, r in drawn)
        tables.append(Table("Holes through the plate, mm", ("x", "y", "diameter", "sink", "use"), rows, (4,)))
    if marker.tag:
        names = ("top left", "top right", "bottom right", "bottom left")
        corners = tuple(
            (name, _fixed(x), _fixed(y)) for name, (x, y) in zip(names, marker.tag.corners.tolist(), strict=True)
        )
        tables.append(Table(f"Corners of the black square of {marker.tag}, mm", ("corner", "x", "y"), corners, (0,)))
    tables.append(_part_list(made.parts))
    if made.tolerances:
        tables.append(Table("Tolerances", ("what", "tolerance"), made.tolerances, (0, 1)))
    return tuple(tables)


def drawn_contours(marker: Marker) -> list[Contour]:
    """Contours in mm of the plate's outline if it is one with arcs from a drawing; else none."""
    outline = marker.substrate.outline or marker.boundary
    return [placed(contour, 1e3, digits=9) for contour in outline.contours()] if outline.has_arcs else []


def drawn_holes(marker: Marker) -> list[tuple[float, float, float]]:
    """Center x, y and radius in mm of the round holes that are part of the plate's outline."""
    holes = [contour.as_circle for contour in drawn_contours(marker) if area(contour) < 0]
    return [(x + 0.0, y + 0.0, r) for x, y, r in filter(None, holes)]


def _part_list(parts: Sequence[Part]) -> Table:
    groups: dict[tuple[str, str, str], list[str]] = {}
    for part in parts:
        key = part.material, _size(part), f"{part.volume / 1e3:.3f}"
        groups.setdefault(key, []).append(part.name)
    rows = tuple(
        (str(len(names)), _names(names), material, size, volume) for (material, size, volume), names in groups.items()
    )
    return Table("Parts", ("pieces", "name", "material", "size, mm", "volume each, cm\xb3"), rows, (1, 2, 3))


def _size(part: Part) -> str:
    """Diameters and height of what is round, else width, height and thickness."""
    low, high = reach([part])
    if len(part.add) == 1 and isinstance(part.add[0], Revolved):
        radii = [r for r, _ in part.add[0].profile.points]
        inner = f" / {DIAMETER}{millimeters(2 * min(radii))}" if min(radii) > SAME else ""
        return f"{DIAMETER}{millimeters(2 * widest(part.add[0]))}{inner} x {millimeters(high - low)}"
    width, height = size_of(part.add)
    if part.is_disk:
        return f"{DIAMETER}{millimeters(width)} x {millimeters(high - low)}"
    return f"{millimeters(width)} x {millimeters(height)} x {millimeters(high - low)}"


def _names(names: Sequence[str]) -> str:
    """``dot-1, dot-3 to dot-5`` for long lists of parts that are alike."""
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
    """``1 to 4, 7`` of whole numbers."""
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


def use_words(hole: Hole) -> str:
    """What a hole is for: ``for screw M3``, ``for a 4 mm pin``."""
    name = hole.name[:LONGEST_NAME]
    if hole.use == "dowel":
        return f"for a {name or 'dowel pin'}"
    return f"for screw {name}" if name else "for a screw"


def _fixed(meters: float) -> str:
    # Adding 0 makes -0 a plain 0.
    return f"{round(meters * 1e3, 4) + 0.0:.4f}"
