"""Regions that are drawn on the page, or moved there: checked, and taken into a state."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from markergen.errors import InputError, brief
from markergen.model.boundary import Boundary, Circle, Polygon
from markergen.optimize.problem import room_of
from markergen.options import as_list
from markergen.read.layout import layout_of
from markergen.read.outlines.boundary import moved
from markergen.studio.showing import table_in
from markergen.studio.state import plain, points_as_text, spec_of_options
from markergen.units import parse_length

Place = tuple[float, float]

DIGITS = 6
"""Decimals of m of what is drawn: whole micrometers."""


def with_region(request: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``options`` with a region that was drawn or moved.

    Parameters
    ----------
    request : mapping
        ``options``, and one of ``room`` and ``keep_out`` (a circle or polygon as in a marker.json, where it was drawn)
        and ``move`` (a table with the ``index`` of a keep-out and ``by``, x and y in m).

    Raises
    ------
    InputError
        If an outline crosses itself or has no area, keep-outs leave nothing of the room, or `spec_of_options`.
    """
    options = dict(table_in(request, "options"))
    plain(options)  # Raises, before any of them is read.
    if "room" in request:
        found = _with_room(options, _drawn(request["room"]))
    elif "keep_out" in request:
        found = {**options, "keep_out": [*_keep_outs(options), _drawn(request["keep_out"]).as_dict()]}
    else:
        found = {**options, "keep_out": _with_moved(_keep_outs(options), table_in(request, "move"))}
    room_of(spec_of_options(found))
    return {"options": found}


def place_in(value: object) -> Place:
    """Return x and y in m of a request; raises InputError if they are none."""
    try:
        x, y = map(float, value)  # type: ignore[call-overload]
    except (TypeError, ValueError):
        raise InputError("x and y in m", brief(value), "reload the page") from None
    if not np.isfinite((x, y)).all():
        raise InputError("x and y in m", brief(value), "reload the page")
    return x, y


def _drawn(shape: object) -> Boundary:
    if not isinstance(shape, Mapping) or shape.get("kind") not in ("circle", "polygon"):
        raise InputError("a circle or polygon", brief(shape), "reload the page")
    if shape["kind"] == "circle":
        x, y = place_in(shape.get("center"))
        return Circle(round(place_in((shape.get("radius"), 0))[0], DIGITS), (round(x, DIGITS), round(y, DIGITS)))
    outlines = [[place_in(corner) for corner in as_list(outline)] for outline in as_list(shape.get("outlines"))]
    return Polygon(tuple(tuple((round(x, DIGITS), round(y, DIGITS)) for x, y in outline) for outline in outlines))


def _keep_outs(options: Mapping[str, Any]) -> list[Any]:
    return as_list(options["keep_out"]) if options.get("keep_out") else []


def _with_room(options: dict[str, Any], room: Boundary) -> dict[str, Any]:
    """The marker's origin is the center of its room, so that all that is there already moves the other way."""
    x, y = np.round(room.center, DIGITS).tolist()
    found = {name: value for name, value in options.items() if name not in ("radius", "boundary")}
    if isinstance(room, Circle):
        found["radius"] = f"{round(1e3 * room.size, DIGITS - 3)!r}mm"
    else:
        found["boundary"] = moved(room, (x, y)).as_dict()
    if keep_outs := _keep_outs(options):
        found["keep_out"] = [_shifted(each, (x, y)) for each in keep_outs]
    if options.get("points"):
        found["points"] = points_as_text([(u - x, v - y, *z) for u, v, *z in layout_of(plain(options)["points"])])
    if "drawing_center" in options:
        u, v = place_in(options["drawing_center"])
        found["drawing_center"] = [round(u + x, 12), round(v + y, 12)]
    return found


def _with_moved(keep_outs: list[Any], move: Mapping[str, Any]) -> list[Any]:
    index, (x, y) = move.get("index"), place_in(move.get("by"))
    if not isinstance(index, int) or not 0 <= index < len(keep_outs):
        raise InputError("the index of a keep-out", brief(index), "reload the page")
    return [_shifted(each, (-x, -y)) if k == index else each for k, each in enumerate(keep_outs)]


def _shifted(keep_out: Any, origin: Place) -> Any:
    """Return a keep-out as it is seen from another origin; one that was typed stays a text."""
    if not isinstance(keep_out, str):
        return moved(spec_of_options({"keep_out": [keep_out]}).keep_outs[0], origin).as_dict()
    shape, _, place = keep_out.partition("@")
    at = [parse_length(each) for each in place.split(",")] if place else [0.0, 0.0]
    return f"{shape}@{points_as_text([[value - start for value, start in zip(at, origin, strict=True)]])}"
