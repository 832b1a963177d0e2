"""Read simulator models: the meshes that they show, in the frame of their link, with their colors.

Unlike in other files, place and orientation count: the link's frame has to be the marker frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, XMLParser

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError, brief
from markergen.guard import Content, check_size
from markergen.guard import read as read_content
from markergen.model.marker import Marker
from markergen.read.meshes import MeshObject
from markergen.verification.mesh import is_closed, surface_of, triangles_of
from markergen.verification.reading import READERS, Reading
from markergen.verification.solids import reading_of
from markergen.verification.surface import Color

Array = NDArray[np.float64]

LINK = "marker"
"""Name of the link, or body in MJCF."""

ANGLE, DISTANCE = 1e-6, 1e-9
"""Rounding of a pose in a model: rad and m."""


@dataclass(frozen=True)
class ShownMesh:
    """A mesh as a model shows it: its path, its color, and its place in the frame of the link, m."""

    path: str
    color: Color
    rotation: Array
    translation: Array
    scale: Array


class _Tree(TreeBuilder):
    def doctype(self, *_: object) -> None:
        """Refuse document types and thus entities."""
        raise ValueError("a document type")


@dataclass(frozen=True)
class Model:
    """Meshes that a model shows, mm, in the frame of its link, and what is wrong with it; sites (3,) by name, m."""

    shown: tuple[MeshObject, ...]
    flaws: tuple[str, ...]
    sites: dict[str | None, Array] | None

    @property
    def whole(self) -> MeshObject:
        """All meshes as one: a plate may be put together from two; its color is that of the widest."""
        corners, colors = [each.corners for each in self.shown], [each.color or (0.5, 0.5, 0.5) for each in self.shown]
        paints = np.repeat(np.arange(len(corners)), [len(each) for each in corners])
        widths = [float(np.ptp(each[..., 0])) if len(each) else 0.0 for each in corners]
        return MeshObject(np.concatenate(corners), color=colors[int(np.argmax(widths))], paints=paints, palette=colors)

    @property
    def pieces(self) -> tuple[MeshObject, ...]:
        """The meshes one by one if each is closed, which spares the work on edges that they share; else as one."""
        return self.shown if all(is_closed(each.corners) for each in self.shown) else (self.whole,)


def _read(kind: str, data: bytes, name: str, marker: Marker) -> Reading:
    """Read what the link of a URDF or SDF shows, or the body of an MJCF with the sites on its dots."""
    model = model_of(kind, data, name)
    read = reading_of(kind, surface_of([model.whole], name), marker)
    points = marker.as_designed.control_points
    wanted = {f"dot-{point.id}": np.array([point.x, point.y, point.z]) for point in points}
    return replace(read, placed=True, flaws=(*model.flaws, *site_flaws(model, wanted), *read.flaws))


for _suffix, _kind in ((".urdf", "URDF"), (".sdf", "SDF"), (".mjcf.xml", "MJCF")):
    READERS.register(_suffix)(partial(_read, _kind))


def model_of(kind: str, data: bytes, name: str) -> Model:
    """Read a ``URDF``, ``SDF`` or ``MJCF`` of one link; raises InputError if it is none that can be read."""
    check_size(Content(name, data), "list")
    shown_in = {"URDF": _of_urdf, "SDF": _of_sdf, "MJCF": _of_mjcf}[kind]
    parser = XMLParser(target=_Tree())
    try:
        parser.feed(data)
        root = parser.close()
        shown, sites = shown_in(root), _sites(root) if kind == "MJCF" else None
    except (ParseError, ValueError, TypeError, KeyError, AttributeError, OverflowError) as error:
        found = brief(str(error)) if isinstance(error, ParseError) else "something else"
        raise InputError(f"a {kind} of one link with meshes in {name}", found, "export it again") from None
    numbers = np.array([[*each.rotation.flat, *each.translation, *each.scale] for each in shown])
    if not len(shown) or not np.isfinite(numbers).all():
        raise InputError(f"meshes at finite places in {name}", "none" if not shown else "others", "export it again")
    meshes = tuple(MeshObject(_corners(each, Path(name)), color=each.color) for each in shown)
    return Model(meshes, tuple(_pose_flaws(shown)), sites)


def _corners(shown: ShownMesh, path: Path) -> Array:
    """Triangles (m, 3, 3) of a mesh in mm, in the frame of the link."""
    inner = shown.path
    for scheme in ("package://", "model://"):
        # The name of the package or the model is that of a folder which holds this file.
        inner = inner.removeprefix(scheme).partition("/")[2] if inner.startswith(scheme) else inner
    folder = path.parent.resolve()
    target = (folder / inner).resolve()
    if not target.is_relative_to(folder) or target.suffix.lower() != ".stl":
        found = brief(shown.path)
        remedy = "export it again: other formats have axes of their own"
        raise InputError(f"meshes as .stl in the folder of {path}", found, remedy)
    (mesh,) = triangles_of("STL", read_content(target, "artifact").data, str(path.parent / inner))
    return 1e3 * (mesh.corners * shown.scale @ shown.rotation.T + shown.translation)


def _pose_flaws(shown: Sequence[ShownMesh]) -> list[str]:
    from scipy.spatial.transform import Rotation

    flaws = []
    for each in shown:
        angle, off = (
            Rotation.from_matrix(each.rotation).magnitude(),
            float(np.linalg.norm(each.translation)),
        )
        said = [f"turned by {np.degrees(angle):.4g} degrees"] if angle > ANGLE else []
        said += [f"{1e3 * off:.4g} mm off"] if off > DISTANCE else []
        if said:
            flaws.append(f"{each.path} is {' and '.join(said)} in the frame of its link")
    return flaws


def _sites(root: Element) -> dict[str | None, Array]:
    return {site.get("name"): _numbers(site.get("pos"), 3) for site in _link(root, "body").iter("site")}


def site_flaws(model: Model, wanted: Mapping[str, Array]) -> list[str]:
    """Sites that a model lacks or has elsewhere, of those that it should have, by name with their places (3,) in m."""
    flaws, sites = [], model.sites
    if sites is None:
        return []
    for name, place in wanted.items():
        if name not in sites:
            flaws.append(f"there is no site {name}")
            continue
        off = float(np.linalg.norm(sites[name] - place))
        # Negated, so that nan fails too.
        if not off <= DISTANCE:
            flaws.append(f"the site {name} is {1e3 * off:.4g} mm off")
    return flaws


def _of_urdf(root: Element) -> list[ShownMesh]:
    named = {each.get("name"): each.find("color") for each in root.findall("material")}
    shown = []
    for visual in _link(root, "link").findall("visual"):
        mesh, origin, material = _mesh(visual), visual.find("origin"), visual.find("material")
        color = material.find("color") if material is not None else None
        if color is None and material is not None:
            color = named.get(material.get("name"))
        pose = [*_numbers(_get(origin, "xyz"), 3), *_numbers(_get(origin, "rpy"), 3)]
        scale = _numbers(_get(mesh, "scale"), 3, 1.0)
        shown.append(_shown(mesh.attrib["filename"], _get(color, "rgba"), pose, scale))
    return shown


def _of_sdf(root: Element) -> list[ShownMesh]:
    shown = []
    for visual in _link(root, "link").findall("visual"):
        mesh, pose = _mesh(visual), visual.find("pose")
        place = _numbers(pose.text if pose is not None else None, 6)
        if pose is not None and pose.get("degrees") == "true":
            place[3:] = np.radians(place[3:])
        scale = _numbers(mesh.findtext("scale"), 3, 1.0)
        shown.append(_shown(mesh.findtext("uri", "").strip(), visual.findtext("material/diffuse"), [*place], scale))
    return shown


def _of_mjcf(root: Element) -> list[ShownMesh]:
    from scipy.spatial.transform import Rotation

    compiler = root.find("compiler")
    folder = _get(compiler, "meshdir")
    meshes = {mesh.get("name"): mesh for mesh in root.findall("asset/mesh")}
    colors = {material.get("name"): material.get("rgba") for material in root.findall("asset/material")}
    shown = []
    for geom in _link(root, "body").findall("geom"):
        if geom.get("mesh") is None:
            continue
        mesh = meshes[geom.get("mesh")]
        if {"axisangle", "xyaxes", "zaxis"} & set(geom.keys()) or {"refpos", "refquat"} & set(mesh.keys()):
            raise ValueError("other orientations")
        turn = Rotation.from_quat(_numbers(geom.get("quat"), 4, first=1.0)[[1, 2, 3, 0]])
        if geom.get("euler") is not None:
            turn = Rotation.from_euler("XYZ", _numbers(geom.get("euler"), 3), _get(compiler, "angle") != "radian")
        color = _color(colors.get(geom.get("material")) or geom.get("rgba"))
        path = f"{folder}/{mesh.attrib['file']}" if folder else mesh.attrib["file"]
        shift, scale = _numbers(geom.get("pos"), 3), _numbers(mesh.get("scale"), 3, 1.0)
        shown.append(ShownMesh(path, color, turn.as_matrix(), shift, scale))
    return shown


def _link(root: Element, kind: str) -> Element:
    """Return the marker's link: the only one, or the one of its name among several."""
    links = list(root.iter(kind))
    (link,) = links if len(links) == 1 else [each for each in links if each.get("name") == LINK]
    return link


def _mesh(visual: Element) -> Element:
    found = visual.find("geometry/mesh")
    if found is None:
        raise KeyError("mesh")
    return found


def _shown(path: str, color: str | None, pose: list[float], scale: Array) -> ShownMesh:
    """Make it of a pose x, y, z, roll, pitch, yaw: turns about the fixed axes x, y, z in this order."""
    from scipy.spatial.transform import Rotation

    return ShownMesh(path, _color(color), Rotation.from_euler("xyz", pose[3:]).as_matrix(), np.array(pose[:3]), scale)


def _get(element: Element | None, key: str) -> str | None:
    return None if element is None else element.get(key)


def _color(text: str | None) -> Color:
    red, green, blue = (float(word) for word in (text or "0.5 0.5 0.5").split()[:3])
    return red, green, blue


def _numbers(text: str | None, count: int, default: float = 0.0, first: float | None = None) -> Array:
    """Numbers of a text; without one all are the default, or the first has a value of its own."""
    if text is None:
        return np.array([default if first is None else first, *[default] * (count - 1)])
    found = np.array([float(word) for word in text.split()])
    if found.shape != (count,):
        raise ValueError(f"{count} numbers")
    return found
