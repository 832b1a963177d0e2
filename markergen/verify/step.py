"""STEP: circles from the entities of the text, without any CAD kernel."""

import re

from markergen.errors import InputError
from markergen.model.marker import Marker
from markergen.verify.reading import READERS, Page, Reading, circles_of

LARGEST_STEP = 100_000_000

FLUSH = 1e-6
"""How far in mm a circle may be off the marker's plane, which is that of the dots' faces."""

_ENTITY = re.compile(r"#(\d+)\s*=\s*([A-Z_0-9]*)\s*\(([^;]*)\)\s*;")
_UNIT = re.compile(r"SI_UNIT\s*\(\s*(\.\w+\.|\$)\s*,\s*\.METRE\.\s*\)")
_MILLI = {".MILLI.": 1.0, "$": 1000.0, ".CENTI.": 10.0, ".MICRO.": 1e-3}
_REFERENCE, _NUMBER = re.compile(r"#(\d+)"), re.compile(r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")


@READERS.register(".step", ".stp")
def read(data: bytes, name: str, marker: Marker) -> Reading:  # noqa: ARG001  (every reader is called alike)
    """Circles of a STEP file in the plane z = 0, each once."""
    text = data[:LARGEST_STEP].decode("ascii", "replace")
    if not text.lstrip().startswith("ISO-10303-21") or "END-ISO-10303-21" not in text:
        raise InputError(f"a complete STEP file in {name}", "no beginning or end of one", "export it again")
    units = {_MILLI.get(unit) for unit in _UNIT.findall(text)}
    if len(units) != 1 or None in units:
        raise InputError(f"one unit of length in {name}", f"{len(units)} or an unknown one", "export it in mm")
    unit = float(units.pop() or 1.0)
    entities = {number: (kind, body) for number, kind, body in _ENTITY.findall(text)}

    def numbers(reference: str) -> list[float]:
        body = entities.get(reference, ("", ""))[1]
        return [float(value) for value in _NUMBER.findall(body.partition(",")[2])]

    def origin(reference: str) -> list[float]:
        places = _REFERENCE.findall(entities.get(reference, ("", ""))[1])
        return numbers(places[0]) if places else []

    _check_placed(entities, origin, name)
    circles, seen = [], set()
    for kind, body in entities.values():
        if kind != "CIRCLE":
            continue
        references, (*_, last) = _REFERENCE.findall(body), body.split(",")
        place, size = origin(references[0]) if references else [], _NUMBER.fullmatch(last.strip())
        if len(place) != 3 or size is None or abs(place[2]) * unit > FLUSH:
            continue
        circle = (unit * place[0], unit * place[1], unit * float(size[0]))
        # Plate and inlay share their circles.
        if circle not in seen:
            seen.add(circle)
            circles.append(circle)
    return Reading("STEP", (Page(circles_of(circles, name)),))


def _check_placed(entities: dict[str, tuple[str, str]], origin, name: str) -> None:  # type: ignore[no-untyped-def]
    """Refuse parts that an assembly moves: their circles are not where they are written."""
    for kind, body in entities.values():
        if kind == "ITEM_DEFINED_TRANSFORMATION":
            ends = [origin(reference) for reference in _REFERENCE.findall(body)[-2:]]
            if len(ends) == 2 and ends[0] != ends[1]:
                raise InputError(f"parts in place in {name}", "an assembly that moves them", "export it as one part")
