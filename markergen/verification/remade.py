"""Files that only markergen writes: made again from marker.json, and compared value by value.

Order of keys and rows, spaces and digits do not count. A value that differs is a finding, as is one that is missing,
there twice, or one more that a program reads; other keys and comments are listed.
"""

# tests: tests/verification/test_remade.py

import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

import numpy as np

from markergen.arrays import Array
from markergen.errors import InputError, brief, reason_of
from markergen.exporters import EXPORTERS, ExportOptions, Output
from markergen.guard import Content, check_size, text_of
from markergen.guard import read as read_content
from markergen.model.body import Body
from markergen.model.fabrication import Fabrication
from markergen.model.json_text import parsed
from markergen.read.poses.rows import RowsFile
from markergen.verification.reading import READERS, Settings
from markergen.verification.result import (
    MOST_LISTED,
    THROUGH_PLANE,
    Check,
    Finding,
    nearest_mistake,
    other_plate,
    scale_finding,
)
from markergen.verification.solid_files import read_solid
from markergen.verification.wanted_solids import on_plate

LISTED = 1e-6
"""Default tolerance of lengths in m: nothing rounds them."""

RELATIVE, LEAST = 1e-6, 1e-10
"""Tolerance of other numbers, of which models have nine digits: as a share, and at the least."""

UNIT = 0.005
"""Maximum deviation of a quaternion's norm from 1, beyond which tf2 refuses the transform."""

NOTHING = 1e-3
"""Length in m below which its ratio to another says nothing."""

RECORD = "markergen export "
"""Beginning of the comment that records the options of an export, as JSON."""

_LENGTHS = """
x y z x_m y_m z_m diameter diameter_m inner_diameter inner_diameter_m radius length size corners corner_x corner_y side
tag_corners object_points diameters pos pose xyz quiet_zone clearance center mesh
"""
LENGTHS = frozenset(_LENGTHS.split())
"""Names of values that are lengths, in m."""

DEFAULTS = {"xyz": 0.0, "rpy": 0.0, "pose": 0.0, "pos": 0.0, "scale": 1.0}
"""Values that stand for themselves where they are left out: all of their numbers are this."""

HARMLESS = frozenset({"provenance", "extensions", "compiler#", "compiler@angle", "compiler@assetdir", "dt"})
"""Keys whose values say nothing about how the marker is made, drawn, simulated or read."""

_READ = """
robot link joint parent child axis limit dynamics mimic inertial inertia mass origin pose visual collision geometry box
cylinder sphere capsule ellipsoid plane heightmap polyline mesh uri submesh scale filename texture color rgba material
ambient diffuse specular emissive shininess script shader pbr metal albedo_map transparency cast_shadows light camera
visibility_flags laser_retro gazebo mujoco plugin sensor model include static gravity kinematic self_collide enable_wind
surface friction contact bounce frame world actor road density auto_inertia velocity_decay must_be_base_link
particle_emitter audio_sink audio_source battery projector double_sided placement_frame canonical_link relative_to
degrees rotation_format transmission safety_controller turnGravityOff mu1 mu2 kp kd value xyz rpy quat radius length
size ixx iyy izz ixy ixz iyz
id ids x y z points point object_points diameter diameters inner_diameter feature kind tag tags tag_ids tag_id layout
tag_corners tag_dictionary tag_dictionary_name tag_family family corner_x corner_y corners unit units frame_id name
child_frame_id translation rotation target_type tagRows tagCols tagSize tagSpacing targetRows targetCols rows cols data
rowSpacingMeters colSpacingMeters tag_bundles standalone_tags qw qx qy qz
"""
READ_BY_PROGRAMS = frozenset(_READ.split())
"""Names that change what a program makes of a file: of URDF, whose readers skip others, and of lists of points.

MuJoCo refuses what it does not know, and of SDF all names are those of its specification.
"""

Value = str | float | int | bool | None
Leaves = dict[str, tuple[Value, ...]]
"""Values by path, such as ``dot 3/x`` or ``link/inertial/mass@value``."""


@dataclass
class Tree:
    """Content of a file: values by path, paths that are there twice, comments, and meshes that it refers to."""

    leaves: Leaves = field(default_factory=dict)
    doubled: list[str] = field(default_factory=list)
    comments: list[str] = field(default_factory=list)
    meshes: dict[str, str] = field(default_factory=dict)

    def add(self, path: str, *values: Value) -> None:
        """Add the values of a path."""
        if path in self.leaves:
            self.doubled.append(path)
        self.leaves.setdefault(path, values)


Parser = Callable[[str, str], Tree]
"""Parser of a file's text; the name is for messages."""


# --- Parsers ----------------------------------------------------------------------------------------------------------


def _table(text: str, name: str) -> Tree:
    """Rows of a table by the id of their dot."""
    tree = Tree(comments=_comments(text))
    table = RowsFile(name, text.encode()).table()
    columns, *rows = [[cell.strip() for cell in row] for _, row in table] or [[]]
    tree.doubled += [column for column in set(columns) if columns.count(column) > 1]
    if not {"id", "x_m", "y_m", "z_m"} <= set(columns) or any(len(row) != len(columns) for row in rows):
        raise InputError(f"columns id, x_m, y_m and z_m in {name}", "others", "export it again")
    for row in rows:
        cells = dict(zip(columns, row, strict=True))
        for column, cell in cells.items():
            tree.add(f"dot {_id(cells['id'])}/{column}", cell)
    return tree


def _json(text: str, name: str) -> Tree:
    tree, content = Tree(), parsed(text, name)
    if not isinstance(content, dict):
        raise InputError(f"a marker.json in {name}", "something else", "export it again")
    _flatten(tree, "", content)
    return tree


def _yaml(text: str, name: str) -> Tree:
    import yaml

    tree = Tree(comments=_comments(text))

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """Loader that knows OpenCV's matrices, and reports keys that are there twice."""

    def mapping(loader: Any, node: Any) -> dict[Any, Any]:
        keys = [str(key.value) for key, _ in node.value]
        tree.doubled.extend(key for key in dict.fromkeys(keys) if keys.count(key) > 1)
        return dict(loader.construct_mapping(node, deep=True))

    for tag in ("tag:yaml.org,2002:map", "tag:yaml.org,2002:opencv-matrix"):
        Loader.add_constructor(tag, mapping)
    try:
        # FileStorage has a directive of its own.
        content = yaml.load(re.sub(r"\A%YAML:1\.0\s*(---)?", "", text), Loader)
    except (yaml.YAMLError, RecursionError, ValueError, TypeError, AttributeError) as error:
        raise InputError(f"complete YAML in {name}", reason_of(error), "export it again") from None
    if (family := re.search(r"tag_family: *'(\w+)'", text)) and isinstance(content, dict):
        tree.add("tag_family", family[1])
    if not isinstance(content, dict):
        raise InputError(f"keys and values in {name}", brief(str(content)), "export it again")
    try:
        _flatten(tree, "", _by_dot(content))
    except RecursionError:
        raise InputError(f"complete YAML in {name}", "endless nesting", "export it again") from None
    return tree


def _by_dot(content: dict[Any, Any]) -> dict[Any, Any]:
    """Values of parallel lists, as ROS and OpenCV have them, by the ids of the dots."""
    content = {key: _by_dot(value) if isinstance(value, dict) else value for key, value in content.items()}
    matrices = {key: _matrix(value) for key, value in content.items() if isinstance(value, dict) and "data" in value}
    content |= matrices
    ids = content.get("ids")
    if not isinstance(ids, list):
        return content
    names = [_id(row[0] if isinstance(row, list) and row else row) for row in ids]
    parallel = ("x", "y", "z", "diameter", "object_points", "diameters")
    lists = {key: content.pop(key) for key in parallel if isinstance(content.get(key), list)}
    del content["ids"]
    content["points"] = [
        {"id": name, **{key: values[k] for key, values in lists.items() if k < len(values)}}
        for k, name in enumerate(names)
    ]
    content |= {key: f"{len(values)} rows" for key, values in lists.items() if len(values) != len(names)}
    return content


def _matrix(value: dict[Any, Any]) -> list[Any]:
    """Rows of an OpenCV matrix."""
    data, columns = value.get("data"), value.get("cols")
    data = data if isinstance(data, list) else []
    if re.fullmatch(r"\d*[ucwsi]", str(value.get("dt"))):
        # OpenCV reads whole numbers.
        data = [float(np.trunc(item)) if isinstance(item, float) else item for item in data]
    columns = columns if isinstance(columns, int) and columns > 0 else 1
    rows = [data[k : k + columns] for k in range(0, len(data), columns)]
    return rows if value.get("rows") == len(rows) else [*rows, "rows", value.get("rows")]


def _flatten(tree: Tree, path: str, value: Any) -> None:
    if isinstance(value, dict):
        for key, inner in _one_sign(value).items():
            _flatten(tree, f"{path}/{key}" if path else str(key), inner)
    elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
        names = [item.get("id", item.get("name")) for item in value]
        distinct = path != "bodies" and None not in names and len({_id(item) for item in names}) == len(names)
        for k, item in enumerate(value):
            named = names[k] if distinct or "id" in item else f"[{k}]"
            point = "dot " if path.endswith("points") else "tag " if path.endswith("layout") else f"{path}/"
            here = f"{path.rpartition('/')[0]}/{point}" if point.endswith(" ") and "/" in path else point
            _flatten(tree, f"{here}{_id(named)}", item)
    elif isinstance(value, list):
        tree.add(path, *_scalars(value))
    else:
        tree.add(path, value)


def _one_sign(value: dict[Any, Any]) -> dict[Any, Any]:
    """A quaternion with its largest part positive: its negative is the same rotation."""
    parts = {key: value[key] for key in ("qw", "qx", "qy", "qz") if isinstance(value.get(key), float | int)}
    if len(parts) < 4 or max(parts.values(), key=abs) >= 0:
        return value
    return value | {key: -part + 0.0 for key, part in parts.items()}


def _scalars(values: list[Any]) -> Iterator[Value]:
    for value in values:
        if isinstance(value, list):
            yield from _scalars(value)
        else:
            yield value if isinstance(value, str | float | int | bool | None) else str(value)


def _id(value: object) -> str:
    """Name of a dot: a whole number however it is written."""
    try:
        return f"{float(str(value)):g}"
    except ValueError:
        return str(value)


class _Builder(TreeBuilder):
    def doctype(self, *_: object) -> None:
        """Refuse document types and thus entities."""
        raise ValueError("a document type")


def _xml(root_tag: str, kind: str, text: str, name: str) -> Tree:
    """Attributes and texts of a simulator's model."""
    tree = Tree()

    def comment(text: str | None) -> Element:
        # Also one outside of the root element.
        tree.comments.append((text or "").strip())
        return Element("comment")

    parser = XMLParser(target=_Builder(comment_factory=comment))
    try:
        parser.feed(text.encode())
        root = parser.close()
        folder = next((item.get("meshdir") for item in root.iter("compiler") if item.get("meshdir")), "")
        _elements(tree, "", root, f"{folder}/" if folder else "")
    except (ParseError, ValueError, RecursionError) as error:
        raise InputError(f"a {kind} of one link with meshes in {name}", reason_of(error), "export it again") from None
    if root.tag != root_tag or not tree.meshes:
        raise InputError(f"a {kind} of one link with meshes in {name}", "something else", "export it again")
    return tree


def _elements(tree: Tree, path: str, element: Element, folder: str, deep: int = 0) -> None:
    if deep > 50:
        raise ValueError("elements within elements, beyond 50")
    tree.add(f"{path}#", "")
    for key, value in element.attrib.items():
        if key in ("filename", "file") and element.tag == "mesh":
            tree.meshes[f"{path}/mesh"] = folder + value
        elif key not in ("name", "meshdir") or not path:
            tree.add(f"{path}@{key}", *(value.split() or [""]))
    text = (element.text or "").strip()
    if element.tag == "uri" and path.endswith("mesh/uri"):
        tree.meshes[path.removesuffix("/uri") + "/mesh"] = text
    elif text:
        tree.add(path, *text.split())
    count: dict[str, int] = {}
    for child in element:
        # One of several without a name is known by its number.
        base = f"{child.tag} {child.get('name')}" if child.get("name") else str(child.tag)
        count[base] = count.get(base, 0) + 1
        numbered = base if count[base] == 1 else f"{base} [{count[base]}]"
        _elements(tree, f"{path}/{numbered}" if path else numbered, child, folder, deep + 1)
        tail = (child.tail or "").strip()
        if tail:
            tree.comments.append(tail)


def _comments(text: str) -> list[str]:
    return [line.lstrip("# ").rstrip() for line in text.splitlines() if line.startswith("#")]


# --- Comparison -------------------------------------------------------------------------------------------------------


def _verified(suffix: str, kind: str, parse: Parser, data: bytes, name: str, body: Body, settings: Settings) -> Check:
    """Compare a file with what is made of the body, by the options that it records, those asked for, or the defaults.

    Raises InputError if it is no such file, or the body has none.
    """
    check_size(Content(name, data), "list")
    tree = parse(text_of(Content(name, data)), name)
    tolerance = LISTED if settings.tolerance is None else settings.tolerance
    recorded = [text.removeprefix(RECORD) for text in tree.comments if text.startswith(RECORD)]
    tree.comments = [text for text in tree.comments if not text.startswith(RECORD)]
    dots = 0 if suffix == ".apriltag.yaml" else len(body.xyz)
    of_plate, notes = list[Finding](), [] if dots else ["it holds the tag alone, and no dots"]
    choices = list(dict.fromkeys([settings.fabrication, Fabrication()]))
    if recorded:
        asked, remade_body = _recorded(recorded[0], body, name)
        choices = [asked]
        if any(new.marker is not old.marker for new, old in zip(remade_body.plates, body.plates, strict=True)):
            of_plate, of_thickness = _of_another_plate(body, remade_body)
            notes, body = notes + of_thickness, remade_body
    exporter, checks = EXPORTERS[suffix], []
    if not exporter.purpose(body.frame):
        wanted, remedy = f"a sheet or a solid of a {body.frame}", "verify it against the one marker in it"
        raise InputError(wanted, f"a {suffix}", remedy)
    for choice in choices:
        output = exporter(body, ExportOptions(fabrication=choice))
        checks.append(_compared(kind, tree, parse(output.data.decode(), name), output, name, tolerance))
        if checks[-1].passed:
            break
    check = min(checks, key=lambda check: len(check.findings))
    if tree.meshes and not recorded and not check.passed:
        notes.append("it records no options of its export: give those that it was made with, such as --process cnc")
    return replace(
        check, dots=dots, copies=1, tolerance=tolerance, pages=(None,), findings=(*of_plate, *check.findings),
        notes=(*notes, *check.notes), scale=(1.0, 1.0) if dots and check.passed else check.scale,
    )  # fmt: skip


def _recorded(text: str, body: Body, name: str) -> tuple[Fabrication, Body]:
    """Options of an export, and the body with the plate that it was made with."""
    try:
        record = json.loads(text)
        plate = record.pop("substrate", None)
        fabrication = Fabrication(**record)
    except (ValueError, TypeError, AttributeError, KeyError):
        raise InputError(f"options of an export in {name}", brief(text), "export it again") from None
    return fabrication, body if plate is None else on_plate(body, plate, name)


def _of_another_plate(body: Body, made: Body) -> tuple[list[Finding], list[str]]:
    """Finding about a plate that is not that of marker.json; a note if it is thicker or thinner alone."""
    wanted, plate = (either.plates[0].marker.substrate.as_dict() for either in (body, made))
    differing = [key for key in {**wanted, **plate} if wanted.get(key) != plate.get(key)]
    thick, usual = (1e3 * values["thickness"] for values in (plate, wanted))
    if differing == ["thickness"]:
        return [], [f"the plate is {thick:.5g} mm thick, where marker.json says {usual:.6g} mm"]
    return [other_plate(differing)], []


def _compared(kind: str, tree: Tree, wanted: Tree, output: Output, name: str, tolerance: float) -> Check:
    """Findings about all that differs."""
    findings, notes = list[Finding](), list[str]()
    findings += [
        Finding("twice", f"{path} is there twice", "leave one of both") for path in dict.fromkeys(_tops(tree.doubled))
    ]
    largest, worst, ratios = 0.0, None, list[float]()
    axis, mirrored = _mirrored(tree.leaves, wanted.leaves, tolerance)
    wrong, missing = [Finding("mirrored", OPPOSITE[axis], "export it again")] if axis else [], list[str]()
    for path, values in wanted.leaves.items():
        key = _key(path)
        if _is_harmless(path):
            continue
        if path not in tree.leaves:
            if key not in DEFAULTS or not _is_default(key, values):
                missing.append(path)
            continue
        here = tree.leaves[path]
        away = _distance(here, values)
        if "_transform/" in path and (key == "frame_id" or (key != "child_frame_id" and away is not None)):
            if away != 0:
                notes.append(f"{path} is {_text(here)}: where in the map the marker hangs")
            continue
        size = max((abs(number) for value in values if (number := _number(value)) is not None), default=0.0)
        allowed = tolerance if key in LENGTHS else max(LEAST, RELATIVE * size)
        name_of_dot = re.search(r"\bdot[ -](\w+)", path)
        if key in LENGTHS and name_of_dot and away is not None and away >= largest:
            largest, worst = away, name_of_dot[1]
        # Negated, so that nan fails too.
        if (away is None or not away <= allowed) and path not in mirrored:
            wrong.append(Finding(_kind(path, key), f"{path} is {_text(here)}, not {_text(values)}", "export it again"))
        if key in LENGTHS and away is not None:
            pairs = [(_number(a), _number(b)) for a, b in zip(here, values, strict=True)]
            ratios += [a / b for a, b in pairs if a is not None and b is not None and abs(b) > NOTHING]
    rotation = "_transform/ros__parameters/rotation/"
    quaternion = [_number(here[0]) or 0.0 for path, here in tree.leaves.items() if rotation in path]
    norm = float(np.linalg.norm(quaternion))
    if quaternion and not abs(norm - 1) <= UNIT and not wrong:
        sentence = f"the quaternion of the transform has a norm of {norm:.4g}, not 1"
        wrong.append(Finding("value", sentence, "give the rotation as a unit quaternion"))
    ratio = float(np.median(ratios)) if ratios else 1.0
    even = bool(ratios) and max(abs(value / ratio - 1) for value in ratios) < 1e-6 if ratio else False
    if even and abs(ratio - 1) > RELATIVE and any(finding.kind in ("shifted", "diameter", "tag") for finding in wrong):
        times = nearest_mistake(ratio)
        ratio = times if abs(ratio / times - 1) < 1e-6 else ratio
        wrong = [scale_finding(ratio, ratio, np.array([1e3, 1e3]), 1e-6), *(f for f in wrong if f.kind == "value")]
    findings += wrong
    findings += [Finding("missing", f"{path} is missing", "export it again") for path in _tops(missing)]
    extra = [path for path in tree.leaves if path not in wanted.leaves]
    for path in _tops(extra):
        below = [other for other in extra if other == path or other.startswith((f"{path}/", f"{path}@", f"{path}#"))]
        key = _key(path)
        if key in DEFAULTS and all(_is_default(key, tree.leaves[other]) for other in below):
            continue
        if _is_read(kind, below) and not all(map(_is_harmless, below)):
            sentence = f"{path} is extra: {_text(tree.leaves.get(path, tree.leaves.get(path + '#', ())))}".rstrip(": ")
            findings.append(Finding("extra", sentence, "remove what is not the marker's"))
        else:
            notes.append(f"not written by markergen, and not read: {path}")
    mesh_findings, off = _meshes(tree, wanted, output, name, tolerance)
    findings += mesh_findings
    comments = [text for text in tree.comments if text not in wanted.comments and not text.startswith("sha256 ")]
    notes += [f"a comment: {brief(text)}" for text in comments[:MOST_LISTED]]
    if len(findings) > MOST_LISTED:
        more = len(findings) - MOST_LISTED
        findings = [*findings[:MOST_LISTED], Finding("value", f"{more} more values differ", "export it again")]
    good = not findings
    return Check(
        "", kind, largest=max(largest, off) if good or worst else np.nan, worst=worst,
        scale=(ratio, ratio) if even else (np.nan, np.nan), findings=tuple(findings), notes=tuple(notes),
    )  # fmt: skip


OPPOSITE = {
    "x": "mirrored: x of every dot has the opposite sign",
    "y": "mirrored: y of every dot has the opposite sign",
    "z": THROUGH_PLANE,
}
"""What is wrong where all dots have the opposite sign along an axis."""


def _mirrored(leaves: Leaves, wanted: Leaves, tolerance: float) -> tuple[str, set[str]]:
    """Axis along which all dots, right otherwise, have the opposite sign, and the paths of their places; else empty."""
    places: dict[str, list[tuple[float, float]]] = {axis: [] for axis in OPPOSITE}
    paths = set[str]()
    for path, values in wanted.items():
        match = (
            re.fullmatch(r"([xyz])(?:_m)?|xyz|object_points|pos", _key(path)) if re.search(r"\bdots?\b", path) else None
        )
        if match and path in leaves:
            paths.add(path)
            for axis, value, right in zip(match[1] or "xyz", leaves[path], values, strict=False):
                numbers = _number(value), _number(right)
                places[axis].append((np.nan if numbers[0] is None else numbers[0], numbers[1] or 0.0))
    opposite = []
    for axis, pairs in places.items():
        have, want = np.array(pairs).reshape(-1, 2).T
        if (np.abs(have - want) <= tolerance).all():
            continue
        opposite.append(axis if (np.abs(have + want) <= tolerance).all() else "")
    return (opposite[0], paths) if len(opposite) == 1 and opposite[0] else ("", set())


def _key(path: str) -> str:
    return re.split(r"[/@]", path)[-1].split(" ")[0]


def _is_harmless(path: str) -> bool:
    return path == "bodies/[0]/name" or not HARMLESS.isdisjoint([path, *path.split("/")])


def _kind(path: str, key: str) -> str:
    """Kind of a finding about a value."""
    if re.search(r"\btag", path):
        return "tag"
    names = {"z": "height", "z_m": "height", "kind": "kind", "feature": "kind", "rgba": "color", "diffuse": "color"}
    if "diameter" in key:
        return "diameter"
    return names.get(key, "shifted" if re.search(r"\bdot[ -]", path) else "value")


def _tops(paths: Sequence[str]) -> list[str]:
    """Paths without those that are inside of others."""
    whole = [path.removesuffix("#") for path in paths if path.endswith("#")]
    dots = dict.fromkeys(match[0] for path in paths if (match := re.match(r"(?:.*/)?(?:dot|tag) [^/@]+(?=/)", path)))
    tops = [*whole, *dots]
    inside = tuple(f"{top}{mark}" for top in tops for mark in "/@")
    kept = [path for path in tops if not path.startswith(inside)]
    return kept + [path for path in paths if not (path.endswith("#") or path in tops or path.startswith(inside))]


def _is_read(kind: str, paths: Sequence[str]) -> bool:
    """Tell whether programs read one of these paths."""
    if kind in ("MJCF", "SDF"):
        return True
    names = {part.split(" ")[0].rstrip("#") for path in paths for part in re.split(r"[/@]", path)[-2:]}
    last = {_key(path).rstrip("#") for path in paths}
    return bool(last & READ_BY_PROGRAMS) or not names.isdisjoint({"dot", "dots", "tag"})


def _is_default(key: str, values: Sequence[Value]) -> bool:
    return all(_number(value) == DEFAULTS[key] for value in values if value != "")


def _number(value: Value) -> float | None:
    if isinstance(value, bool) or value is None:
        return None
    try:
        return float(value)
    except ValueError:
        return None


def _distance(here: Sequence[Value], values: Sequence[Value]) -> float | None:
    """Largest difference of numbers; 0 for equal texts; None for others, or for another number of them."""
    if len(here) != len(values):
        return None
    largest = 0.0
    for a, b in zip(here, values, strict=True):
        if str(a) == str(b) or (a == b and isinstance(a, bool) == isinstance(b, bool)):
            continue
        x, y = _number(a), _number(b)
        if x is not None and y is not None:
            if not np.isfinite(x - y):
                return None
            largest = max(largest, abs(x - y))
        elif str(a).strip().lower() != str(b).strip().lower():
            return None
    return largest


def _text(values: Sequence[Value]) -> str:
    return brief(" ".join(f"{value + 0.0:.12g}" if isinstance(value, float) else str(value) for value in values))


# --- Meshes -----------------------------------------------------------------------------------------------------------


def _meshes(tree: Tree, wanted: Tree, output: Output, name: str, tolerance: float) -> tuple[list[Finding], float]:
    """Compare the meshes that a model refers to; and the largest distance in m of a corner from its place."""
    findings, largest = list[Finding](), 0.0
    for path, file in tree.meshes.items():
        target = _target(file, Path(name))
        if path not in wanted.meshes:
            continue  # Its element is reported as extra.
        data, good = read_content(target, "artifact").data, output.beside[wanted.meshes[path]]
        if data == good:
            continue
        off = _apart(_corners(data, file), _corners(good, file), tolerance)
        largest = max(largest, off)
        if not off <= tolerance:
            how = _how(_corners(data, file), _corners(good, file), tolerance)
            sentence = f"{file} is not the mesh of the marker{how}"
            findings.append(Finding("mesh", sentence, "export it again with its meshes"))
    findings += [
        Finding("missing", f"{file} is not shown", "export it again")
        for path, file in wanted.meshes.items()
        if path not in tree.meshes and f"{path.removesuffix('/mesh')}#" in tree.leaves
    ]
    return findings, largest


def _target(file: str, path: Path) -> Path:
    inner = file
    for scheme in ("package://", "model://"):
        # The name of the package or the model is that of a folder which holds this file.
        inner = inner.removeprefix(scheme).partition("/")[2] if inner.startswith(scheme) else inner
    folder = path.parent.resolve()
    target = (folder / inner).resolve()
    if not target.is_relative_to(folder) or target.suffix.lower() != ".stl":
        remedy = "export it again: other formats have axes of their own"
        raise InputError(f"meshes as .stl in the folder of {path}", brief(file), remedy)
    return target


def _corners(data: bytes, name: str) -> Array:
    return read_solid("STL", data, name).shell.corners


def _apart(corners: Array, wanted: Array, tolerance: float) -> float:
    """Largest distance in m of a corner from its place, whatever the order of triangles; infinite if they differ."""
    from scipy.spatial import cKDTree

    if len(corners) != len(wanted):
        return np.inf
    rolled = np.concatenate([np.roll(corners, k, axis=1).reshape(-1, 9) for k in range(3)])
    distance, index = cKDTree(rolled).query(wanted.reshape(-1, 9), distance_upper_bound=3 * tolerance)
    if len(np.unique(index % len(corners))) < len(wanted):
        return np.inf
    return float(distance.max(initial=0.0))


def _how(corners: Array, wanted: Array, tolerance: float) -> str:
    """In which way a mesh differs as a whole."""
    if not len(corners):
        return ": it is empty"
    if len(corners) != len(wanted):
        return f": it has {len(corners)} triangles instead of {len(wanted)}"
    sizes = [float(np.ptp(mesh.reshape(-1, 3), axis=0).max()) for mesh in (corners, wanted)]
    if abs(sizes[0] / sizes[1] - 1) > 1e-4:
        return f": it is scaled by {sizes[0] / sizes[1]:.5g}"
    for axis, signs in zip("xyz", 1.0 - 2.0 * np.eye(3), strict=True):
        # Programs that mirror a mesh keep its triangles inside out, or not.
        if any(_apart(mesh * signs, wanted, tolerance) <= tolerance for mesh in (corners, corners[:, ::-1])):
            return f": it is mirrored along {axis}"
    apart = np.linalg.norm(corners.reshape(-1, 3).mean(axis=0) - wanted.reshape(-1, 3).mean(axis=0))
    return f": it is elsewhere, or turned ({1e3 * apart:.3g} mm between their middles)"


for _suffix, _kind_name, _parse in (
    (".csv", "CSV", _table),
    (".json", "JSON", _json),
    (".detector.json", "JSON", _json),
    (".opencv.yaml", "OpenCV", _yaml),
    (".ros2.yaml", "ROS 2", _yaml),
    (".kalibr.yaml", "Kalibr", _yaml),
    (".apriltag.yaml", "AprilTag", _yaml),
    (".urdf", "URDF", partial(_xml, "robot", "URDF")),
    (".sdf", "SDF", partial(_xml, "sdf", "SDF")),
    (".mjcf.xml", "MJCF", partial(_xml, "mujoco", "MJCF")),
):
    READERS.register(_suffix)(partial(_verified, _suffix, _kind_name, _parse))
