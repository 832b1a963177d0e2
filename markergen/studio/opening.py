"""Files that are dropped on the page: read by the readers of the command line, and returned as what a state holds."""

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from markergen.api.inspect import inspect
from markergen.errors import InputError
from markergen.guard import read, text_of
from markergen.model.body_json import load_marker_or_rig, rig_to_json, to_json
from markergen.model.boundary import polygon_from
from markergen.model.json_text import parsed
from markergen.model.marker import Marker
from markergen.model.spec import Spec
from markergen.model.substrate import SCREWS
from markergen.options.declarations import DesignKeywords
from markergen.read.cameras import load_camera
from markergen.read.cameras.covariance import camera_covariance
from markergen.read.dot_tables import read_layout
from markergen.read.kinds import kinds_of
from markergen.read.outlines.boundary import moved_outline, parse_boundary
from markergen.read.poses import read_poses
from markergen.read.remarks import collected_remarks
from markergen.read.spec_file import spec_of
from markergen.read.templates import read_template
from markergen.studio.state import RENAMED, length_as_text, refuse_files, refuse_named_plates, with_lengths_typed

ASKED = re.compile("--boundary-unit|layer")
"""In errors that another unit or layer may mend."""

MEASURED = "measured on a print; shown as designed, markergen validate shows what the print is worth"
NOT_OPTIONS = ("title", "substrate", "target", "n")


@contextmanager
def uploaded(name: str, data: bytes) -> Iterator[Path]:
    """Yield the path of a file with these bytes, for readers that take one; errors name the file as its sender does."""
    with nameless_folder() as folder:
        path = folder / last_name(name)
        path.write_bytes(data)
        yield path


def last_name(name: str) -> str:
    """Return the last part of a sender's name of a file, as any system can have it."""
    return re.sub(r"[^\w.\- ]", "_", name.replace("\\", "/").rpartition("/")[2])[-100:].strip(". ") or "file"


@contextmanager
def nameless_folder() -> Iterator[Path]:
    """Yield a folder for this time, which errors leave out of the names of its files."""
    with TemporaryDirectory() as folder:
        try:
            yield Path(folder)
        except InputError as error:
            raise InputError(*(part.replace(f"{folder}/", "") for part in error.args)) from None


def opened_file(
    name: str,
    data: bytes,
    unit: str | None = None,
    layer: str | None = None,
    origin: Sequence[float] = (0.0, 0.0),
) -> dict[str, Any]:
    """Return what a file brings into a state, by its suffix and content.

    Parameters
    ----------
    unit, layer : str or None
        For a drawing, see `parse_boundary`.
    origin : sequence of float
        Place in a drawing, in m, that is the marker's origin: the center of another drawing of the same sheet.

    Returns
    -------
    dict
        ``title``, and one of ``options`` (of a marker.json, with ``marker``, its content, or of a spec), ``rig``,
        ``boundary`` (of a drawing, about its own center; with this ``center``, its place in the drawing in m,
        ``keep_out``, the same region about the `origin`, and ``words``), ``asked`` (of a drawing that needs another
        unit or layer: expected, found and remedy), ``camera`` (with ``camera_covariance``, or None), ``poses`` and
        ``points``. A ``note`` says what is shown otherwise than the file has it, or what `markergen.inspect` shows of a
        camera, poses or a drawing.

    Raises
    ------
    InputError
        If the file is none of these, or one that names others.
    """
    kind = ""
    try:
        # What is reported is in the note.
        with collected_remarks(), uploaded(name, data) as path:
            if path.suffix.lower() == ".json":
                parsed(text_of(read(path, "marker or rig")), path.name)
            kind, *_ = kinds_of(path)
            values = _drawn(path, unit, layer, origin) if kind == "outline" else OPENED[kind](path)
            return {"title": path.name, **_noted(kind, path, unit, layer), **values}
    except InputError as error:
        if not (kind == "outline" and ASKED.search(str(error))):
            raise
        return {"title": path.name, "asked": dict(zip(("expected", "found", "remedy"), error.args, strict=True))}


def _drawn(path: Path, unit: str | None, layer: str | None, origin: Sequence[float]) -> dict[str, Any]:
    there = parse_boundary(path, unit, layer, "file")
    room = polygon_from(there.contours())
    regions = {"boundary": room, "keep_out": moved_outline(there, origin)}
    return {name: region.as_dict() for name, region in regions.items()} | {"center": there.center, "words": str(room)}


def _noted(kind: str, path: Path, unit: str | None, layer: str | None) -> dict[str, str]:
    """Return what `markergen.inspect` shows of a camera, poses or a drawing, in a line."""
    if kind not in ("camera", "poses", "outline"):
        return {}
    asked: Any = {key: value for key, value in (("boundary_unit", unit), ("layer", layer)) if value}
    inspection = inspect(path, kind=kind, **asked)
    rows = (f"{name} {text}" for name, text in inspection.facts[0].rows.items())
    # Without the folder that it was put into.
    remarks = (line.replace(f"{path.parent}/", "") for line in inspection.remarks)
    return {"note": ". ".join(["; ".join(rows), *remarks])}


def _spec(path: Path) -> dict[str, Any]:
    values = read_template(str(path))
    title = {"title": str(values["title"])} if "title" in values else {}
    options = {RENAMED.get(key, key): value for key, value in values.items() if key != "title"}
    refuse_files(options, DesignKeywords)
    return {**title, "options": with_lengths_typed(options)}


def _camera(path: Path) -> dict[str, Any]:
    camera = load_camera(path)
    covariance = camera_covariance(None, path, camera)
    return {"camera": camera.as_dict(), "camera_covariance": None if covariance is None else covariance.tolist()}


def _rig(path: Path) -> dict[str, Any]:
    refuse_named_plates(json.loads(path.read_bytes()))
    return {"rig": json.loads(rig_to_json(load_marker_or_rig(path)))}  # type: ignore[arg-type]


def _marker(path: Path) -> dict[str, Any]:
    marker = load_marker_or_rig(path)
    assert isinstance(marker, Marker)
    measured = {"note": MEASURED} if marker.as_designed is not marker else {}
    return {"options": options_of(marker), "marker": json.loads(to_json(marker)), **measured}


OPENED: dict[str, Callable[[Path], dict[str, Any]]] = {
    "spec": _spec,
    "camera": _camera,
    "rig": _rig,
    "marker": _marker,
    "poses": lambda path: {"poses": read_poses(path).as_dict()},
    "points": lambda path: {"points": [list(row) for row in read_layout(path)]},
}
"""Functions that make what a state holds of a file of a kind."""


def options_of(marker: Marker) -> dict[str, Any] | None:
    """Return the options that design a marker again without a search; None if its dots have several sizes."""
    if len({point.feature.diameter for point in marker.control_points}) > 1:
        return None
    spec, usual = spec_of(marker), Spec().as_dict()
    if spec is not None:
        values = {key: value for key, value in spec.as_dict().items() if key == "boundary" or value != usual.get(key)}
    else:
        values = {"boundary": marker.boundary.as_dict(), "keep_outs": [region.as_dict() for region in marker.keep_outs]}
        values |= {"tag": str(marker.tag), "tag_side": marker.tag.side} if marker.tag else {}
        values |= {"substrate": marker.substrate.as_dict(), "relief": marker.as_designed.height}
    options = {
        RENAMED.get(key, key): value
        for key, value in values.items()
        if key not in NOT_OPTIONS and value not in (None, "", 0, 0.0, [])
    }
    room = options["boundary"]
    if room.get("kind") == "circle" and not any(room.get("center", (0, 0))):
        options["radius"] = options.pop("boundary")["radius"]
    options |= _plate(values.get("substrate", {}))
    designed = marker.as_designed
    points = designed.xyz if designed.height else designed.xyz[:, :2]
    return with_lengths_typed({**options, "dot": marker.dot_diameter, "points": points.tolist()})


def _plate(substrate: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a plate, whose holes are texts."""
    options = {key: value for key, value in substrate.items() if key != "holes" and value is not None}
    alike = defaultdict[tuple[str, str], list[str]](list)
    for hole in substrate.get("holes", ()):
        kind = hole["name"] + "c" * bool(hole["sink"]) if hole["name"] in SCREWS else length_as_text(hole["diameter"])
        alike[hole["use"], kind].append(f"{length_as_text(hole['x'])},{length_as_text(hole['y'])}")
    for (use, kind), places in alike.items():
        options.setdefault(use, []).append(f"{kind}:{'; '.join(places)}")
    return options
