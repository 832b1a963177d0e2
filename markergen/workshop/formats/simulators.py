"""Simulator models: the marker or the rig as one rigid body, as URDF, SDF and MJCF.

All have one link (in MJCF: body) whose frame is the marker or rig frame, with mass and inertia, simple collision
shapes, and one mesh for each color. The meshes are STL in m: of the formats that simulators load it is the only one
without axes or units of its own, which some programs apply and others do not. glTF has y up: Drake, Blender and newer
versions of RViz rotate it to z up, yourdfpy, Gazebo and older versions of RViz do not, and MuJoCo does not load it.
"""
# tests: tests/workshop/formats/test_simulator.py tests/workshop/formats/test_rig_solids.py

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Self
from xml.sax.saxutils import escape, quoteattr

import numpy as np

import markergen
from markergen.arrays import Array
from markergen.exporters import ExportOptions, Output
from markergen.model.body import Body
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.model.substrate import Substrate
from markergen.solid.primitives import COLORS
from markergen.units import picometers
from markergen.workshop.assembly import volume_of
from markergen.workshop.formats.solids import Designed
from markergen.workshop.mesh import MATERIALS, Mesh, meshed, stl_of

DENSITY = 1240.0
"""Density of polylactide, the usual filament, in kg/m^3."""

MOST_TRIANGLES = 200_000
"""Maximum number of triangles in an STL that MuJoCo loads; balls have more and are put in several."""

FOR_MUJOCO = '  <mujoco><compiler discardvisual="false" strippath="false"/></mujoco>\n'
"""Element by which MuJoCo shows the meshes of a URDF, and finds them in their folder."""

FRAMES = {
    "marker": "Fiducial marker; its link's frame is the marker frame: x right, y up, z out of the face.",
    "rig": "Fiducial markers with a known relation; their link's frame is the rig frame.",
}
"""What a model is, by the name of its link."""


@dataclass(frozen=True)
class Shown:
    """What is seen of one material.

    Attributes
    ----------
    name : str
        The material, and a number from the second file on.
    path : str
        Path of its STL, relative to the file that refers to it.
    """

    name: str
    material: str
    path: str
    stl: bytes

    @property
    def color(self) -> str:
        """Red, green, blue and opacity, 0 to 1."""
        return " ".join(f"{channel:g}" for channel in (*COLORS[self.material], 1.0))

    @property
    def digest(self) -> str:
        """Digest of the STL, to check that it is the intended one."""
        return f"sha256 {sha256(self.stl).hexdigest()}"


@dataclass(frozen=True)
class Collision:
    """A collision shape at its place in the frame of the link.

    Attributes
    ----------
    shape : {"box", "cylinder", "mesh"}
    size : tuple of float
        Width, depth and height of a box, or radius and length of a cylinder; m.
    center : array (3,)
        m.
    rotation : array (3, 3)
    mesh : Shown or None
        What is seen, for the shape of its convex hull.
    """

    name: str
    shape: str
    size: tuple[float, ...]
    center: Array
    rotation: Array
    mesh: Shown | None = None

    @property
    def measures(self) -> dict[str, str]:
        """Dimensions by their names in URDF and SDF."""
        if self.shape == "cylinder":
            return {"radius": decimal(self.size[0]), "length": decimal(self.size[1])}
        return {"size": numbers(np.array(self.size))}

    @property
    def angles(self) -> str:
        """Roll, pitch and yaw."""
        return numbers(roll_pitch_yaw(self.rotation))


@dataclass(frozen=True)
class Site:
    """A place in the frame of the link: a marker's frame or a dot, by name; m."""

    name: str
    place: Array
    rotation: Array
    diameter: float = 0.0


@dataclass(frozen=True)
class Simulated:
    """Marker or rig as a rigid body; m, kg, in its frame.

    Attributes
    ----------
    link : {"marker", "rig"}
        Name of the link, and of its frame.
    sites : tuple of Site
        Frames of a rig's markers, and dots as designed.
    center : array (3,)
        Center of mass.
    inertia : array (3, 3)
        Inertia about the center of mass.
    engraved : bool
        True if a material is only seen on flat marks, a mesh without volume.
    record : str
        Comment with the options of the export that are not the defaults, by which `verify` makes it again.
    """

    name: str
    link: str
    visuals: tuple[Shown, ...]
    sites: tuple[Site, ...]
    mass: float
    center: Array
    inertia: Array
    collisions: tuple[Collision, ...]
    engraved: bool
    notes: tuple[str, ...]
    record: str = ""

    @classmethod
    def of(cls, bodies: Sequence[Marker | Rig], options: ExportOptions, suffix: str) -> Self:
        """Make the body of a marker or a rig; raises as `meshed` does."""
        work, parts = meshed(bodies, options, suffix)
        visuals = _shown(parts, work.name, options.stem)
        mass, center, inertia = mass_of(parts)
        return cls(
            work.name,
            work.subject.frame,
            visuals,
            tuple(_sites(work.subject)),
            mass,
            center,
            inertia,
            tuple(_collisions(work, parts, visuals)),
            any(part.marked.any() for part in parts),
            (
                f"It shows {' and '.join(mesh.path for mesh in visuals)} beside it, and weighs {mass * 1e3:.3g} g "
                f"({DENSITY:g} kg/m^3).",
                *work.notes,
            ),
            _record(work.subject, options.fabrication),
        )

    @property
    def meshes(self) -> dict[str, bytes]:
        """Files of the meshes by path."""
        return {mesh.path: mesh.stl for mesh in self.visuals}

    def moments(self) -> dict[str, str]:
        """Entries of the inertia on and above its diagonal, by name: ``ixx`` and so on."""
        return {
            f"i{a}{b}": decimal(self.inertia[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
        }


def _record(body: Body, fabrication: Fabrication) -> str:
    """Comment with the options that are not the defaults; empty for none."""
    asked = fabrication.shape_options
    plates = [plate.marker.substrate for plate in body.plates]
    if plates[0] != Substrate() and all(plate == plates[0] for plate in plates):
        asked["substrate"] = plates[0].as_dict()
    # Two hyphens would end the comment.
    text = json.dumps(asked).replace("--", "-\\u002d")
    return f"<!-- markergen export {text} -->\n" if asked else ""


def _sites(body: Body) -> Iterator[Site]:
    prefixes = [f"{plate.name}/" if body.frame == "rig" else "" for plate in body.plates]
    for plate, prefix in zip(body.plates, prefixes, strict=True):
        if prefix:
            yield Site(f"{prefix}marker", plate.translation_vector, plate.rotation_matrix)
    for plate, prefix in zip(body.plates, prefixes, strict=True):
        for point in plate.marker.control_points:
            place = plate.to_body(np.array([point.x, point.y, point.z]))
            place = np.array([*map(picometers, place)])
            yield Site(f"{prefix}dot-{point.id}", place, plate.rotation_matrix, point.feature.diameter)


def _collisions(work: Designed, parts: Sequence[Mesh], visuals: Sequence[Shown]) -> Iterator[Collision]:
    """One shape for a marker, one for each plate of an assembly; of a block its box, or the hull of what is light."""
    body = work.made
    points = np.concatenate([mesh.points for mesh in (parts[:1] if body.block else parts)]) / 1e3
    size, middle = np.ptp(points, axis=0), (points.min(axis=0) + points.max(axis=0)) / 2
    if work.subject.frame == "marker":
        yield _simple("collision", size, middle, np.eye(3), [plate.is_disk for plate in body.made[0].plates] == [True])
    elif not body.block:
        for part in body.parts:
            piece = part.pieces[0]
            if piece.part.is_plate:
                (left, bottom, right, top), (back, front) = piece.part.add[0].box, piece.part.add[0].span
                middle = piece.to_body(np.array([left + right, bottom + top, back + front]) / 2) / 1e3
                size = np.array([right - left, top - bottom, front - back]) / 1e3
                yield _simple(f"{part.name}/collision", size, middle, np.array(piece.rotation), piece.part.is_disk)
    elif np.isclose(np.prod(size), 1e-9 * volume_of(body.block), rtol=1e-6):
        yield _simple("collision", size, middle, np.eye(3), False)
    else:
        for visual in visuals:
            if visual.material == "light":
                yield Collision(f"collision-{visual.name}", "mesh", (), np.zeros(3), np.eye(3), visual)


def _simple(name: str, size: Array, center: Array, rotation: Array, is_round: bool) -> Collision:
    """Cylinder or box of a size."""
    if is_round:
        return Collision(name, "cylinder", (size[0] / 2, size[2]), center, rotation)
    return Collision(name, "box", tuple(size), center, rotation)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Angles (3,) in rad about the fixed axes x, y, z in this order of a rotation (3, 3); yaw 0 where it is free."""
    flat = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], flat)
    if flat < 1e-9:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _shown(parts: Sequence[Mesh], name: str, stem: str) -> tuple[Shown, ...]:
    """Meshes of all that is seen in one color, in m: what is engraved shows the other material."""
    visuals = []
    for material in MATERIALS:
        files: list[list[Array]] = []
        for part in parts:
            mine = part.triangles[part.marked == (part.material != material)]
            for start in range(0, len(mine), MOST_TRIANGLES):
                corners = part.points[mine[start : start + MOST_TRIANGLES]] / 1e3
                if not files or sum(map(len, files[-1])) + len(corners) > MOST_TRIANGLES:
                    files.append([])
                files[-1].append(corners)
        for number, pieces in enumerate(files, start=1):
            called = material if number == 1 else f"{material}-{number}"
            stl = stl_of(np.concatenate(pieces), name, "m")
            visuals.append(Shown(called, material, f"meshes/{stem}-{called}.stl", stl))
    return tuple(visuals)


def mass_of(parts: Sequence[Mesh]) -> tuple[float, Array, Array]:
    """Mass in kg, center of mass in m, and inertia about it in kg m^2, of parts of `DENSITY`.

    A closed surface is a signed sum of tetrahedra from the origin. The tetrahedron with the corners 0, a, b, c has
    volume det(a, b, c)/6 and second moment det(a, b, c)/120 (aa' + bb' + cc' + ss') with s = a + b + c.
    """
    corners = np.concatenate([part.points[part.triangles] for part in parts]) / 1e3
    weight = DENSITY * np.linalg.det(corners)
    sums = corners.sum(axis=1)
    mass = float(weight.sum() / 6)
    center = weight @ sums / 24 / mass
    second = np.einsum("t,tci,tcj->ij", weight, corners, corners) + np.einsum("t,ti,tj->ij", weight, sums, sums)
    spread = second / 120 - mass * np.outer(center, center)
    return mass, center, np.trace(spread) * np.eye(3) - spread


def decimal(value: float) -> str:
    """Format a number with nine digits, without -0."""
    return f"{round(float(value), 15) + 0.0:.9g}"


def numbers(values: Array) -> str:
    """Format several numbers, separated by spaces."""
    return " ".join(decimal(value) for value in values)


def export_urdf(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """Write a robot of one link, accompanied by ``meshes/<stem>-light.stl`` and ``-dark.stl``."""
    body = Simulated.of(bodies, options, ".urdf")
    path = body.visuals[0].path
    notes = (
        f"RViz finds the meshes once they are in a package, as package://<package>/{path}; for Gazebo write .sdf.",
        *body.notes,
    )
    return Output(_robot(body).encode(), notes, body.meshes)


def _robot(body: Simulated) -> str:
    moments = " ".join(f'{name}="{value}"' for name, value in body.moments().items())
    visuals = "".join(
        f"""    <visual name="{item.name}">
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <!-- {item.digest} -->
      <geometry><mesh filename={quoteattr(item.path)}/></geometry>
      <material name="{item.material}"><color rgba="{item.color}"/></material>
    </visual>
"""
        for item in body.visuals
    )
    collisions = "".join(
        f"""    <collision>
      <origin xyz="{numbers(item.center)}" rpy="{item.angles}"/>
      <geometry><{_urdf_shape(item)}/></geometry>
    </collision>
"""
        for item in body.collisions
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
{body.record}<robot name="{body.name}">
{"" if body.engraved else FOR_MUJOCO}  <link name="{body.link}">
    <inertial>
      <origin xyz="{numbers(body.center)}" rpy="0 0 0"/>
      <mass value="{decimal(body.mass)}"/>
      <inertia {moments}/>
    </inertial>
{visuals}{collisions}  </link>
</robot>
"""


def _urdf_shape(collision: Collision) -> str:
    if collision.mesh is not None:
        return f"mesh filename={quoteattr(collision.mesh.path)}"
    return " ".join([collision.shape, *(f'{name}="{value}"' for name, value in collision.measures.items())])


def export_sdf(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """Write a model of one link, accompanied by ``model.config`` and the meshes of `export_urdf`."""
    body = Simulated.of(bodies, options, ".sdf")
    beside = {"model.config": _config(body, options.stem).encode(), **body.meshes}
    return Output(_model(body).encode(), body.notes, beside)


def _model(body: Simulated) -> str:
    moments = "".join(f"<{name}>{value}</{name}>" for name, value in body.moments().items())
    visuals = "".join(
        f"""      <visual name="{item.name}">
        <pose>0 0 0 0 0 0</pose>
        <!-- {item.digest} -->
        <geometry><mesh><uri>{escape(item.path)}</uri></mesh></geometry>
        <material><ambient>{item.color}</ambient><diffuse>{item.color}</diffuse></material>
      </visual>
"""
        for item in body.visuals
    )
    collisions = "".join(
        f"""      <collision name={quoteattr(item.name)}>
        <pose>{numbers(item.center)} {item.angles}</pose>
        <geometry>{_sdf_shape(item)}</geometry>
      </collision>
"""
        for item in body.collisions
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
{body.record}<sdf version="1.7">
  <model name="{body.name}">
    <static>true</static>
    <link name="{body.link}">
      <inertial>
        <pose>{numbers(body.center)} 0 0 0</pose>
        <mass>{decimal(body.mass)}</mass>
        <inertia>{moments}</inertia>
      </inertial>
{visuals}{collisions}    </link>
  </model>
</sdf>
"""


def _sdf_shape(collision: Collision) -> str:
    if collision.mesh is not None:
        return f"<mesh><uri>{escape(collision.mesh.path)}</uri></mesh>"
    inside = "".join(f"<{name}>{value}</{name}>" for name, value in collision.measures.items())
    return f"<{collision.shape}>{inside}</{collision.shape}>"


def _config(body: Simulated, stem: str) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<model>
  <name>{body.name}</name>
  <version>1.0</version>
  <sdf version="1.7">{escape(stem)}.sdf</sdf>
  <author><name>markergen {markergen.__version__}</name></author>
  <description>{FRAMES[body.link]}</description>
</model>
"""


def export_mjcf(bodies: Sequence[Marker | Rig], options: ExportOptions) -> Output:
    """Write a MuJoCo model of one body, accompanied by the meshes of `export_urdf`.

    It has a site in the marker frame, ``marker``, and one on each dot, ``dot-0`` and so on, in group 4, which viewers
    and cameras hide by default, as they do the collision shape in group 3. A rig has sites ``rig``, ``+x/marker``, in
    the frame of that marker, and ``+x/dot-0``.
    """
    body = Simulated.of(bodies, options, ".mjcf.xml")
    notes = ("The body is fixed; <attach> it, or give it a <freejoint/>, to move it.", *body.notes)
    return Output(_body(body).encode(), notes, body.meshes)


def _body(body: Simulated) -> str:
    moments = body.moments()
    inertia = " ".join(moments[name] for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    # Some meshes are open, where the other material is engraved; no volume is taken from any.
    colors = {item.material: item.color for item in body.visuals}
    materials = "".join(
        f"""    <material name="{name}" rgba="{color}" specular="0"/>
"""
        for name, color in colors.items()
    )
    assets = "".join(
        f"""    <!-- {item.digest} -->
    <mesh name="{item.name}" file={quoteattr(item.path)} inertia="shell"/>
"""
        for item in body.visuals
    )
    visuals = "".join(
        f"""      <geom name="{item.name}" class="seen" mesh="{item.name}" material="{item.material}"/>
"""
        for item in body.visuals
    )
    collisions = "".join(
        f"""      <geom name={quoteattr(item.name)} {_mjcf_shape(item)} group="3"/>
"""
        for item in body.collisions
    )
    sites = "".join(
        f"""      <site name={quoteattr(item.name)} class="place" pos="{numbers(item.place)}"{_euler(item.rotation)}\
{f' size="{decimal(item.diameter / 4)}"' if item.diameter else ""}/>
"""
        for item in body.sites
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
{body.record}<mujoco model="{body.name}">
  <default>
    <default class="seen"><geom type="mesh" group="2" contype="0" conaffinity="0"/></default>
    <default class="place"><site group="4"/></default>
  </default>
  <asset>
{materials}{assets}  </asset>
  <worldbody>
    <body name="{body.link}">
      <inertial pos="{numbers(body.center)}" mass="{decimal(body.mass)}" fullinertia="{inertia}"/>
{visuals}{collisions}      <site name="{body.link}" class="place"/>
{sites}    </body>
  </worldbody>
</mujoco>
"""


def _mjcf_shape(solid: Collision) -> str:
    """Type, half of the size, and place; a mesh stands for its convex hull."""
    if solid.mesh is not None:
        return f'type="mesh" mesh="{solid.mesh.name}"'
    halves = (solid.size[0], solid.size[1] / 2) if solid.shape == "cylinder" else np.array(solid.size) / 2
    return (
        f'type="{solid.shape}" size="{numbers(np.array(halves))}" pos="{numbers(solid.center)}"{_euler(solid.rotation)}'
    )


def _euler(rotation: Array) -> str:
    """Rotation as a quaternion w, x, y, z; nothing for none."""
    from scipy.spatial.transform import Rotation

    if np.array_equal(rotation, np.eye(3)):
        return ""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return f' quat="{numbers(np.array([w, x, y, z]))}"'
