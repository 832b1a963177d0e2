"""Simulator models: the marker as one rigid body, as URDF, SDF and MJCF.

All have one link (in MJCF: body) whose frame is the marker frame, with mass and inertia, a simple collision shape, and
one mesh for each color. The meshes are STL in m: of the formats that simulators load it is the only one without axes or
units of its own, which some programs apply and others do not. glTF has y up: Drake, Blender and newer versions of RViz
rotate it to z up, yourdfpy, Gazebo and older versions of RViz do not, and MuJoCo does not load it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Self
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.exporters import ExportOptions, Output, only
from markergen.exporters.meshes import MATERIALS, MeshedPart, meshed, stl_of
from markergen.model.marker import ControlPoint, Marker
from markergen.solid.bodies import COLORS

Array = NDArray[np.float64]

DENSITY = 1240.0
"""Density of polylactide, the usual filament, in kg/m^3."""

MOST_TRIANGLES = 200_000
"""Maximum number of triangles in an STL that MuJoCo loads; balls have more and are put in several."""

FOR_MUJOCO = '  <mujoco><compiler discardvisual="false" strippath="false"/></mujoco>\n'
"""Element by which MuJoCo shows the meshes of a URDF, and finds them in their folder."""


@dataclass(frozen=True)
class Shown:
    """What is seen of one material.

    Attributes
    ----------
    name : str
        The material, and a number from the second file on.
    material : str
    path : str
        Path of its STL, relative to the file that refers to it.
    stl : bytes
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
class Simulated:
    """Marker as a rigid body; m, kg, marker frame.

    Attributes
    ----------
    name : str
    shown : tuple of Shown
    points : tuple of ControlPoint
        As designed.
    mass : float
    center : array (3,)
        Center of mass.
    inertia : array (3, 3)
        Inertia about the center of mass.
    low, high : array (3,)
        Corners of its bounding box.
    round : bool
        True if its collision shape is a cylinder about the z axis rather than that box.
    engraved : bool
        True if a material is only seen on flat marks, a mesh without volume.
    notes : tuple of str
    """

    name: str
    shown: tuple[Shown, ...]
    points: tuple[ControlPoint, ...]
    mass: float
    center: Array
    inertia: Array
    low: Array
    high: Array
    round: bool
    engraved: bool
    notes: tuple[str, ...]

    @classmethod
    def of(cls, markers: Sequence[Marker], options: ExportOptions, suffix: str) -> Self:
        """Make the body of a marker; raises as `meshed` does."""
        made = meshed(markers, options, suffix)
        shown = _shown(made.parts, made.name, options.stem)
        points = np.concatenate([part.mesh.points for part in made.parts]) / 1e3
        mass, center, inertia = mass_of(made.parts)
        return cls(
            made.name,
            shown,
            only(markers, suffix).as_designed.control_points,
            mass,
            center,
            inertia,
            points.min(axis=0),
            points.max(axis=0),
            [part.is_disk for part in made.made.parts if part.is_plate] == [True],
            any(part.mesh.marked.any() for part in made.parts),
            (
                f"It shows {' and '.join(each.path for each in shown)} beside it, and weighs {mass * 1e3:.3g} g "
                f"({DENSITY:g} kg/m^3).",
                *made.notes,
            ),
        )

    @property
    def meshes(self) -> dict[str, bytes]:
        """Files of the meshes by path."""
        return {each.path: each.stl for each in self.shown}

    def collision(self) -> tuple[str, dict[str, str], Array]:
        """Collision shape, ``cylinder`` or ``box``, its dimensions, and its center."""
        size, middle = self.high - self.low, (self.high + self.low) / 2
        if self.round:
            return "cylinder", {"radius": number(size[0] / 2), "length": number(size[2])}, middle
        return "box", {"size": numbers(size)}, middle

    def moments(self) -> dict[str, str]:
        """Entries of the inertia on and above its diagonal, by name: ``ixx`` and so on."""
        return {
            f"i{a}{b}": number(self.inertia[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
        }


def _shown(parts: Sequence[MeshedPart], name: str, stem: str) -> tuple[Shown, ...]:
    """Meshes of all that is seen in one color, in m: what is engraved shows the other material."""
    shown = []
    for material in MATERIALS:
        files: list[list[Array]] = []
        for part in parts:
            mine = part.mesh.triangles[part.mesh.marked == (part.material != material)]
            for start in range(0, len(mine), MOST_TRIANGLES):
                corners = part.mesh.points[mine[start : start + MOST_TRIANGLES]] / 1e3
                if not files or sum(map(len, files[-1])) + len(corners) > MOST_TRIANGLES:
                    files.append([])
                files[-1].append(corners)
        for number, pieces in enumerate(files, start=1):
            called = material if number == 1 else f"{material}-{number}"
            stl = stl_of(np.concatenate(pieces), name, "m")
            shown.append(Shown(called, material, f"meshes/{stem}-{called}.stl", stl))
    return tuple(shown)


def mass_of(parts: Sequence[MeshedPart]) -> tuple[float, Array, Array]:
    """Mass in kg, center of mass in m, and inertia about it in kg m^2, of parts of `DENSITY`.

    A closed surface is a signed sum of tetrahedra from the origin. The tetrahedron with the corners 0, a, b, c has
    volume det(a, b, c)/6 and second moment det(a, b, c)/120 (aa' + bb' + cc' + ss') with s = a + b + c.
    """
    corners = np.concatenate([part.mesh.points[part.mesh.triangles] for part in parts]) / 1e3
    weight = DENSITY * np.linalg.det(corners)
    sums = corners.sum(axis=1)
    mass = float(weight.sum() / 6)
    center = weight @ sums / 24 / mass
    second = np.einsum("t,tci,tcj->ij", weight, corners, corners) + np.einsum("t,ti,tj->ij", weight, sums, sums)
    spread = second / 120 - mass * np.outer(center, center)
    return mass, center, np.trace(spread) * np.eye(3) - spread


def number(value: float) -> str:
    """Format a number with nine digits, without -0."""
    return f"{round(float(value), 15) + 0.0:.9g}"


def numbers(values: Array) -> str:
    """Format several numbers, separated by spaces."""
    return " ".join(number(value) for value in values)


def export_urdf(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a robot of one link, accompanied by ``meshes/<stem>-light.stl`` and ``-dark.stl``."""
    body = Simulated.of(markers, options, ".urdf")
    path = body.shown[0].path
    notes = (
        f"RViz finds the meshes once they are in a package, as package://<package>/{path}; for Gazebo write .sdf.",
        *body.notes,
    )
    return Output(_robot(body).encode(), notes, body.meshes)


def _robot(body: Simulated) -> str:
    shape, measures, middle = body.collision()
    inside = " ".join(f'{name}="{value}"' for name, value in measures.items())
    moments = " ".join(f'{name}="{value}"' for name, value in body.moments().items())
    visuals = "".join(
        f"""    <visual name="{each.name}">
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <!-- {each.digest} -->
      <geometry><mesh filename={quoteattr(each.path)}/></geometry>
      <material name="{each.material}"><color rgba="{each.color}"/></material>
    </visual>
"""
        for each in body.shown
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<robot name="{body.name}">
{"" if body.engraved else FOR_MUJOCO}  <link name="marker">
    <inertial>
      <origin xyz="{numbers(body.center)}" rpy="0 0 0"/>
      <mass value="{number(body.mass)}"/>
      <inertia {moments}/>
    </inertial>
{visuals}    <collision>
      <origin xyz="{numbers(middle)}" rpy="0 0 0"/>
      <geometry><{shape} {inside}/></geometry>
    </collision>
  </link>
</robot>
"""


def export_sdf(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a model of one link, accompanied by ``model.config`` and the meshes of `export_urdf`."""
    body = Simulated.of(markers, options, ".sdf")
    beside = {"model.config": _config(body, options.stem).encode(), **body.meshes}
    return Output(_model(body).encode(), body.notes, beside)


def _model(body: Simulated) -> str:
    shape, measures, middle = body.collision()
    inside = "".join(f"<{name}>{value}</{name}>" for name, value in measures.items())
    moments = "".join(f"<{name}>{value}</{name}>" for name, value in body.moments().items())
    visuals = "".join(
        f"""      <visual name="{each.name}">
        <pose>0 0 0 0 0 0</pose>
        <!-- {each.digest} -->
        <geometry><mesh><uri>{escape(each.path)}</uri></mesh></geometry>
        <material><ambient>{each.color}</ambient><diffuse>{each.color}</diffuse></material>
      </visual>
"""
        for each in body.shown
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<sdf version="1.7">
  <model name="{body.name}">
    <static>true</static>
    <link name="marker">
      <inertial>
        <pose>{numbers(body.center)} 0 0 0</pose>
        <mass>{number(body.mass)}</mass>
        <inertia>{moments}</inertia>
      </inertial>
{visuals}      <collision name="collision">
        <pose>{numbers(middle)} 0 0 0</pose>
        <geometry><{shape}>{inside}</{shape}></geometry>
      </collision>
    </link>
  </model>
</sdf>
"""


def _config(body: Simulated, stem: str) -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<model>
  <name>{body.name}</name>
  <version>1.0</version>
  <sdf version="1.7">{escape(stem)}.sdf</sdf>
  <author><name>markergen {markergen.__version__}</name></author>
  <description>Fiducial marker; its link's frame is the marker frame: x right, y up, z out of the face.</description>
</model>
"""


def export_mjcf(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a MuJoCo model of one body, accompanied by the meshes of `export_urdf`.

    It has a site in the marker frame, ``marker``, and one on each dot, ``dot-0`` and so on, in group 4, which viewers
    and cameras hide by default, as they do the collision shape in group 3.
    """
    body = Simulated.of(markers, options, ".mjcf.xml")
    notes = ("The body is fixed; <attach> it, or give it a <freejoint/>, to move it.", *body.notes)
    return Output(_body(body).encode(), notes, body.meshes)


def _body(body: Simulated) -> str:
    shape, measures, middle = body.collision()
    if shape == "cylinder":
        half = f"{measures['radius']} {number(float(measures['length']) / 2)}"
    else:
        half = numbers((body.high - body.low) / 2)
    moments = body.moments()
    inertia = " ".join(moments[name] for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    # Some meshes are open, where the other material is engraved; no volume is taken from any.
    colors = {each.material: each.color for each in body.shown}
    materials = "".join(
        f"""    <material name="{name}" rgba="{color}" specular="0"/>
"""
        for name, color in colors.items()
    )
    assets = "".join(
        f"""    <!-- {each.digest} -->
    <mesh name="{each.name}" file={quoteattr(each.path)} inertia="shell"/>
"""
        for each in body.shown
    )
    visuals = "".join(
        f"""      <geom name="{each.name}" class="seen" mesh="{each.name}" material="{each.material}"/>
"""
        for each in body.shown
    )
    sites = "".join(
        f"""      <site name="dot-{point.id}" class="place" pos="{numbers(np.array([point.x, point.y, point.z]))}" \
size="{number(point.feature.diameter / 4)}"/>
"""
        for point in body.points
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<mujoco model="{body.name}">
  <default>
    <default class="seen"><geom type="mesh" group="2" contype="0" conaffinity="0"/></default>
    <default class="place"><site group="4"/></default>
  </default>
  <asset>
{materials}{assets}  </asset>
  <worldbody>
    <body name="marker">
      <inertial pos="{numbers(body.center)}" mass="{number(body.mass)}" fullinertia="{inertia}"/>
{visuals}      <geom name="collision" type="{shape}" size="{half}" pos="{numbers(middle)}" group="3"/>
      <site name="marker" class="place"/>
{sites}    </body>
  </worldbody>
</mujoco>
"""
