"""Cameras of files with keys and values: found wherever their numbers are, with what stands around them.

A camera is a table with a matrix or focal lengths. Where a file has one, all that is around it and about a camera
belongs to it; where it has several, in a list, in tables of their own or under keys such as K_1 and D_1, each has a
name for ``path#NAME``.
"""

# tests: tests/read/test_camera_programs.py

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from markergen.errors import InputError, brief
from markergen.model.camera import Camera
from markergen.read.cameras import COVARIANCE, NAMES, CameraFormat
from markergen.read.cameras.calibration import calibrated_camera
from markergen.read.cameras.document import KEYS, KNOWN, SIDES, Document, Fields, names_of, plain, tables_in
from markergen.read.cameras.programs import PROGRAMS, values_of

MOST_CAMERAS = 10_000
"""Maximum number of tables and cameras of a file: nerf's may have a camera for every image."""

PART = re.compile(
    r"^(?!.*(board|pattern|target|grid|extrin|pose|stereo|imu|depth)).*?(intrin|distor|calib|cam|param|projection|lens|"
    r"fisheye|(?<![a-z])size$|(img|image)_?size$|resolution|focal|principal|matrix|model$|colou?r$|rgb$|left$|right$|"
    r"value0|data$|result|optics)",
    re.IGNORECASE,
)
"""Keys of tables that belong to the camera around them."""
WHOLE = ("roi", NAMES, COVARIANCE)
"""Keys of tables that have keys such as width for something else."""
_ABOUT = re.compile("model|type", re.IGNORECASE)
_SIDE = r"left|right|cam\d{1,3}|l|r|a|b|\d{1,3}"
_GROUPED = (re.compile(rf"(.+?)_?({_SIDE})", re.IGNORECASE), re.compile(rf"({_SIDE})_(.+)", re.IGNORECASE))
"""Keys of one of several cameras beside each other."""
_LABELS = ("name", "camera_name", "label", "serial", "serialnumber", "id")


@dataclass
class _Found:
    """A camera: the names on the way to it, and its values by their places, some of which have other names."""

    way: tuple[str, ...]
    values: dict[str, Any] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)


def cameras_of(document: Document) -> dict[str, Fields]:
    """Return the cameras of a file by name; the name of a single one is empty."""
    _, values = values_of(document)
    root = Fields(document.name, values, size=document.size)
    document.tables[:] = [root]
    cameras = _search(values, (), set())
    ways = [camera.way for camera in cameras]
    # The first words that differ, or all of them.
    parting = next((i for i in range(20) if len({way[i : i + 1] for way in ways}) == len(ways)), 0)
    labels = [".".join(way[parting : parting + 1] if parting else way[:1]) if len(ways) > 1 else "" for way in ways]
    labels = labels if len(set(labels)) == len(labels) else [".".join(way) for way in ways]
    return {
        label: Fields(document.name, camera.values, "", root.used, document.size, camera.names)
        for label, camera in zip(labels, cameras, strict=True)
    }


def _search(node: Mapping[str, Any], way: tuple[str, ...], visited: set[int]) -> list[_Found]:
    """Find the cameras in a table; each table is visited once, since aliases of YAML may be endless."""
    if id(node) in visited or len(visited) > MOST_CAMERAS:
        return []
    visited.add(id(node))
    inner: list[_Found] = []
    for key, value in node.items():
        for index, (name, child) in enumerate(tables_in(value) if key not in WHOLE else ()):
            cameras = _search(child, (*way, key, *([name] if name else [])), visited)
            for camera in cameras if name else []:
                # A list beside a list of cameras has an item for each.
                camera.values |= _items(node, value, index, way)
            inner += cameras
    groups = _groups(node, way)
    if groups or (not inner and _is_camera(node, way[-1:])):
        inner += groups or [_Found(way)]
    if len(inner) == 1 and not groups:
        inner[0].values |= dict(_leaves(node, way))
    else:
        grouped = {place for camera in groups for place in camera.values}
        scalars = {key: value for key, value in node.items() if not isinstance(value, dict)}
        leaves = [(place, value) for place, value in _leaves(scalars, way) if place not in grouped]
        around = {place: value for place, value in leaves if _ABOUT.search(place) or KNOWN & {*names_of(place)}}
        for camera in inner:
            camera.values |= around
    return inner


def _leaves(node: Mapping[str, Any], way: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Places and values of what belongs to a camera, in this table and in those that are parts of it."""
    for key, value in node.items():
        here = (*way, key)
        if isinstance(value, dict) and "data" not in value and key not in WHOLE:
            if PART.search(key):
                yield from _leaves(value, here)
        elif not (isinstance(value, list) and any(True for _ in tables_in(value))):
            yield ".".join(here), value


def _items(node: Mapping[str, Any], cameras: Sequence[Any], index: int, way: tuple[str, ...]) -> dict[str, Any]:
    lists = {
        key: value for key, value in node.items() if plain(key) in KNOWN and isinstance(value, list)
        and len(value) == len(cameras) and value is not cameras and all(isinstance(item, list) for item in value)
    }  # fmt: skip
    return {".".join((*way, key)): value[index] for key, value in lists.items()}


def _is_camera(node: Mapping[str, Any], parent: tuple[str, ...]) -> bool:
    """True for a table with a matrix or focal lengths, or one that lacks them beside a size and coefficients."""
    keys = {name: value for key, value in node.items() for name in names_of(".".join((*parent, key)))}

    def has(*kinds: str) -> bool:
        return any(
            not isinstance(keys.get(plain(name), {}), dict) or "data" in keys.get(plain(name), {})
            for kind in kinds
            for name in KEYS[kind]
        )

    return has("matrix", "fx", "focal") or (has("size", "width") and has("coefficients") and has("model"))


def _groups(node: Mapping[str, Any], way: tuple[str, ...]) -> list[_Found]:
    """Cameras whose keys end or begin with a number or a side, such as K_00 and D_00."""
    matrices, groups = set(map(plain, KEYS["matrix"])), dict[str, _Found]()
    if any(plain(key) in matrices for key in node):
        return []
    for key, value in node.items():
        several = isinstance(value, list | dict) or (isinstance(value, str) and len(value.split()) > 1)
        for form, base in ((_GROUPED[0], 1), (_GROUPED[1], 2)):
            match = form.fullmatch(key)
            if match and plain(match[base]) in (KNOWN if several else SIDES):
                camera = groups.setdefault(match[3 - base].lower(), _Found((*way, match[3 - base])))
                place = ".".join((*way, key))
                camera.values[place], camera.names[place] = value, match[base]
                break
    return [camera for camera in groups.values() if matrices & set(map(plain, camera.names.values()))]


def camera_table(document: Document, choice: str | None) -> Fields:
    """Return the table of the camera after ``#``, or of the only one, or of cam0; raises InputError."""
    cameras = cameras_of(document)
    names = list(cameras)
    if choice is None and (len(names) == 1 or "cam0" in names or len({_numbers(cameras[name]) for name in names}) == 1):
        return cameras["cam0" if "cam0" in names else names[0]]
    listed = ", ".join(brief(name)[1:-1] for name in names[:20])
    if choice is None:
        raise InputError(f"a camera's name after {document.name}, such as #{names[0][:40]}", listed, "choose one")
    for name, table in cameras.items():
        stated = [str(table.values[key]).strip("\"'") for label in _LABELS if (key := table.find(label))]
        ways = {word for place in table.values for word in place.split(".")} if len(names) == 1 else set()
        if choice in (name, f"cam{name}", *stated, *ways) or name in (f"cam{choice}", f"cam_{choice}"):
            return table
    if len(names) == 1:
        raise InputError(f"no camera name after {document.name}", brief(choice), "leave it out: it holds one camera")
    raise InputError(f"the camera {brief(choice)} in {document.name}", listed, f"add #{names[0][:40]} to the path")


def _numbers(table: Fields) -> str:
    """All that is known of a camera, to compare it: nerf may repeat one for every image."""
    names = ((names_of(table.names.get(place, place))[-1], value) for place, value in table.values.items())
    return repr(sorted((name, str(value)) for name, value in names if name in KNOWN))


def keyed(name: str, **written: Any) -> CameraFormat:
    """Return the format of a program in `PROGRAMS`, with the endings, `holds` and `write` of one that is written."""

    def fits(document: Document) -> bool:
        return values_of(document)[0] == name and bool(cameras_of(document))

    def read(document: Document, choice: str | None) -> Camera:
        return calibrated_camera(camera_table(document, choice), PROGRAMS[name].corner)

    return CameraFormat(PROGRAMS[name].signs, fits, read, table=camera_table, **written)
