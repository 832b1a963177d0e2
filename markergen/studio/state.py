"""The state of the studio: options of a design as a page holds them, and what to type to get there again."""

# tests: tests/studio/test_regions.py tests/studio/test_server.py

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from decimal import Decimal
from functools import lru_cache
from typing import Any

import numpy as np

from markergen import __version__
from markergen.api.design import design, request_of
from markergen.api.names import names_of, takes_names
from markergen.drawing.paper import find_paper, paper_of_locale
from markergen.errors import InputError, brief
from markergen.exporters import catalog
from markergen.exporters.png import pixels_per_meter
from markergen.model.boundary import Boundary, Circle, Polygon
from markergen.model.camera import NAMED_CAMERAS, SIZE_AND_ANGLE, typical_camera
from markergen.model.poses import is_named
from markergen.model.spec import Spec
from markergen.optimize.design import Design
from markergen.optimize.problem import room_of
from markergen.options import GROUPS, STAGES, Option, as_list, declared, settle
from markergen.options.declarations import OUTSIDE_SPEC, DesignKeywords
from markergen.options.kinds import KINDS
from markergen.options.rig import RigKeywords
from markergen.read.dot_tables import is_table, parsed_layout
from markergen.read.outlines.boundary import is_drawing, moved_outline
from markergen.read.poses.conventions import READING
from markergen.read.rig_plates import SUFFIXES
from markergen.read.spec_file import DRAWING
from markergen.read.templates import read_template, shipped_templates
from markergen.units import parse_length

Options = Mapping[str, Any]

ELSEWHERE = OUTSIDE_SPEC
"""Options of a design that are not part of a state: files to write, and the time to do it in."""

NOTES = ("drawing_center", "sized")
"""What a page keeps in its state beside the options: the place in a drawing, in m, that became the marker's origin, and
the `dot` that a search has found."""

RENAMED = {"keep_outs": "keep_out", "tag_side": "tag_size"}
"""Names in a spec of options that are called differently."""

SPEC = ".toml"

KEPT = 16
"""Number of designs in memory."""


def declared_options() -> dict[str, Any]:
    """All that a page needs: groups of options with help, defaults and choices; units, formats, templates, stages."""
    return {
        "version": __version__,
        "forms": {"marker": _form(DesignKeywords), "rig": _form(RigKeywords)},
        "units": names_of("boundary_unit"),
        "papers": [name for name in names_of("paper") if not name.endswith("-landscape")],
        "paper": paper_of_locale(os.environ),
        "formats": [
            *({"suffix": suffix, "words": title} for suffixes, title in catalog() for suffix in suffixes),
            {"suffix": SPEC, "words": "spec: the options, for markergen design --template"},
        ],
        "templates": list(map(_template, shipped_templates())),
        "stages": STAGES,
    }


def _form(table: type) -> list[dict[str, Any]]:
    """Groups of the options of a table that a state can have."""
    # Drawings are asked for theirs when they are opened.
    fields = [option for option in declared(table).values() if option.name not in (*ELSEWHERE, *DRAWING, *READING)]
    groups = (
        {"name": group, "options": [_field(option) for option in fields if option.group == group]} for group in GROUPS
    )
    return [group for group in groups if group["options"]]


def _field(option: Option) -> dict[str, Any]:
    return {
        "name": option.name,
        "flag": option.flag,
        "kind": option.kind,
        "help": option.help,
        "default": option.default,
        "shown": option.shown,
        "metavar": option.metavar,
        "repeatable": KINDS[option.kind].repeatable,
        "choices": names_of(option.name) if takes_names(option) else [],
    }


def _template(name: str) -> dict[str, Any]:
    values = read_template(name)
    title, shape = str(values.pop("title", "")), values.pop("shape", None)
    # Options of a design, or of the rig with a shape.
    options = {RENAMED.get(key, key): value for key, value in values.items()}
    return {"name": name, "title": title, "shape": shape, "options": options}


def plain_options(options: Any, table: type = DesignKeywords) -> dict[str, Any]:
    """Return a state without empty values, numbers written as text turned into numbers; or options of another table.

    Raises
    ------
    InputError
        If it is no mapping, has an option that a state cannot have, or names a file.
    """
    if not isinstance(options, Mapping):
        raise InputError("the options of a design", brief(options), "send a table of names and values")
    options_of_table, state = declared(table), {}
    for name, value in options.items():
        if name in ELSEWHERE:
            raise InputError("options of a layout", f"{name}={brief(value)}", "leave it out")
        if name in NOTES or value is None or value in ("", [], {}):
            continue
        kind = options_of_table[name].kind if name in options_of_table else ""
        if name == "points" and isinstance(value, list):
            with suppress(ValueError):  # What is wrong with it is told with all else.
                value = points_as_text(parsed_layout(value))
        state[name] = _number(value, kind) if isinstance(value, str) else value
    refuse_files(state, table)
    return state


def points_as_text(rows: Sequence[Sequence[float]]) -> str:
    """Write points in m as they are typed, in mm, to a tenth of a nanometer."""
    return "; ".join(",".join(f"{round(1e3 * value, 7) + 0.0!r}mm" for value in row) for row in rows)


def with_lengths_typed(options: Options) -> dict[str, Any]:
    """Return options whose lengths in m are texts in mm, as fields have them: the same to the last bit."""
    lengths = {name for name, option in declared(DesignKeywords).items() if option.kind.startswith("length")}
    return {
        name: length_as_text(value) if name in lengths and isinstance(value, float) else value
        for name, value in options.items()
    }


def length_as_text(meters: float) -> str:
    """Write a length in m as it is typed, in mm.

    >>> length_as_text(0.0214), length_as_text(1.0)
    ('21.4mm', '1000mm')
    """
    return f"{Decimal(repr(float(meters))).scaleb(3).normalize():f}mm"


def _number(text: str, kind: str) -> Any:
    """Number of a kind from text as it is typed; other text as it is."""
    try:
        return {"int": int, "int or auto": int, "float": float}[kind](text)
    except (KeyError, ValueError):
        return text


def spec_of_options(options: Any) -> Spec:
    """Return the spec of a state; raises InputError as `markergen.design`, also for what only some files need."""
    plain = plain_options(options)
    request = request_of(plain)
    sheet = request.choices.sheet
    if sheet.paper is not None:
        find_paper(sheet.paper, sheet.orientation)
    pixels_per_meter(request.choices.dpi)
    return request.spec


def design_of(options: Any) -> Design:
    """Return the design of a state with points, as the command makes it, with all that it says; the latest are kept.

    Raises
    ------
    InputError
        As `markergen.design`, or if the state has no points, which would take a search.
    """
    state = plain_options(options)
    if "points" not in state:
        raise InputError("the points of a layout", "none", "optimize first, or place the dots")
    return _designed(json.dumps(state, sort_keys=True))


@lru_cache(maxsize=KEPT)
def _designed(state: str) -> Design:
    return design(**json.loads(state))


def rig_of(shape: object, options: Any) -> tuple[str, dict[str, Any]]:
    """Return the shape and the options of a rig; raises InputError as `plain`, or if the shape is none or a file."""
    if not isinstance(shape, str) or shape.strip().lower().endswith(SUFFIXES):
        raise InputError("the shape of a rig", brief(shape), "write cube, prism:6, wall 3x2 or pair")
    return shape, plain_options(options, RigKeywords)


def words(options: Any) -> dict[str, str]:
    """Say a state as a command, as Python, and as a spec file in TOML; all three make the same marker, or rig.

    A state that cannot be typed in a line, such as one with a boundary that was drawn, has its command write the spec
    first.
    """
    import tomli_w

    shape = options.get("shape") if isinstance(options, Mapping) else None
    table: type
    if shape is None:
        state, table, verb, noun, file = plain_options(options), DesignKeywords, "design", "marker", "marker.pdf"
        spec, first = tomli_w.dumps(state), []
    else:
        shape, state = rig_of(shape, {name: value for name, value in options.items() if name != "shape"})
        table, verb, noun, file = RigKeywords, "rig", "rig", "rig.json"
        spec, first = tomli_w.dumps({"shape": shape, **state}), [shape]
    options_of_table = declared(table)
    settle({name: value for name, value in state.items() if name not in options_of_table}, table)
    if any(_nested(value) for value in state.values()):
        # In a spec no line is EOF.
        command = f"cat > {noun}.toml <<'EOF'\n{spec}EOF\nmarkergen {verb} --template {noun}.toml -o {file}"
    else:
        typed = [word for name, value in state.items() for word in _typed(options_of_table[name].flag, value)]
        command = shlex.join(["markergen", verb, *first, *typed, "-o", file])
    arguments = "".join(
        f"\n    {argument}," for argument in [*map(repr, first), *(f"{k}={v!r}" for k, v in state.items())]
    )
    python = f'import markergen as mg\n\ndesign = mg.{verb}({arguments}\n)\ndesign.{noun}.save("{file}")\n'
    return {"command": command, "python": python, "spec": spec}


def _nested(value: Any) -> bool:
    return isinstance(value, Mapping) or (isinstance(value, list) and any(not isinstance(item, str) for item in value))


def _typed(flag: str, value: Any) -> list[str]:
    """Words of the command line for an option; a flag that is switched off is named --no-..."""
    if isinstance(value, bool):
        return [flag if value else flag.replace("--", "--no-", 1)]
    return [word for item in (value if isinstance(value, list) else [value]) for word in (flag, str(item))]


def table_in(request: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    """Return a table of a request; raises InputError if it is none."""
    value = request.get(key)
    if not isinstance(value, Mapping):
        raise InputError(f"a table under {key}", brief(value), "reload the page")
    return value


def refuse_files(options: Mapping[str, Any], table: type) -> None:
    """Refuse options that name a file instead of having its content, and those of files to write.

    Raises
    ------
    InputError
        Naming the first such option.
    """
    for name, option in declared(table).items():
        value = options.get(name)
        if value is not None and _names_one(value, option.kind):
            raise _named(option.flag, value, option.kind == "camera")
    plate = options.get("substrate")
    for name, value in (
        ("keep_outs", options.get("keep_outs")),
        ("substrate.outline", plate.get("outline") if isinstance(plate, Mapping) else None),
    ):
        if value is not None and _names_one(value, "shapes"):
            raise _named(name, value)


def refuse_named_plates(content: Mapping[str, Any]) -> None:
    """Refuse a rig.json whose markers are other files; raises InputError."""
    markers = content.get("markers")
    for plate in markers if isinstance(markers, list) else ():
        if isinstance(plate, Mapping) and plate.get("file"):
            remedy = "write all into one with: markergen export rig.json -o whole.json"
            raise InputError("a rig.json with its markers inside", f"the file {brief(plate['file'])}", remedy)


def _names_one(value: object, kind: str) -> bool:
    if kind in ("camera", "covariance"):
        return isinstance(value, str) and not (kind == "camera" and typical_camera(value))
    if kind in ("shape", "shapes"):
        return any(isinstance(text, str) and text.strip() and is_drawing(text) for text in as_list(value))
    if kind == "poses":
        return isinstance(value, str) and not is_named(value)
    return kind == "files" or (kind == "layout" and is_table(value))


def _named(flag: str, value: object, camera: bool = False) -> InputError:
    names = f"write {' or '.join([*NAMED_CAMERAS, SIZE_AND_ANGLE])}" if camera else "correct it"
    remedy = f"{names}, or open the file in the page, which takes its content along"
    return InputError(f"{flag} without a file, in the studio", brief(value), remedy)


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
    plain_options(options)  # Raises, before any of them is read.
    if "room" in request:
        changed = _with_room(options, _drawn(request["room"]))
    elif "keep_out" in request:
        changed = {**options, "keep_out": [*_keep_outs(options), _drawn(request["keep_out"]).as_dict()]}
    else:
        changed = {**options, "keep_out": _with_moved(_keep_outs(options), table_in(request, "move"))}
    room_of(spec_of_options(changed))
    return {"options": changed}


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
    changed = {name: value for name, value in options.items() if name not in ("radius", "boundary")}
    if isinstance(room, Circle):
        changed["radius"] = f"{round(1e3 * room.size, DIGITS - 3)!r}mm"
    else:
        changed["boundary"] = moved_outline(room, (x, y)).as_dict()
    if keep_outs := _keep_outs(options):
        changed["keep_out"] = [_translated(region, (x, y)) for region in keep_outs]
    if options.get("points"):
        changed["points"] = points_as_text(
            [(u - x, v - y, *z) for u, v, *z in parsed_layout(plain_options(options)["points"])]
        )
    if "drawing_center" in options:
        u, v = place_in(options["drawing_center"])
        changed["drawing_center"] = [round(u + x, 12), round(v + y, 12)]
    return changed


def _with_moved(keep_outs: list[Any], move: Mapping[str, Any]) -> list[Any]:
    index, (x, y) = move.get("index"), place_in(move.get("by"))
    if not isinstance(index, int) or not 0 <= index < len(keep_outs):
        raise InputError("the index of a keep-out", brief(index), "reload the page")
    return [_translated(region, (-x, -y)) if k == index else region for k, region in enumerate(keep_outs)]


def _translated(keep_out: Any, origin: Place) -> Any:
    """Return a keep-out as it is seen from another origin; one that was typed stays a text."""
    if not isinstance(keep_out, str):
        return moved_outline(spec_of_options({"keep_out": [keep_out]}).keep_outs[0], origin).as_dict()
    shape, _, place = keep_out.partition("@")
    at = [parse_length(coordinate) for coordinate in place.split(",")] if place else [0.0, 0.0]
    return f"{shape}@{points_as_text([[value - start for value, start in zip(at, origin, strict=True)]])}"
