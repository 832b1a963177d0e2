"""Simulator models: the marker as one rigid body displayed by its GLB, as URDF and as SDF.

Both have a link whose frame is the marker frame, with mass and inertia, and a simple collision shape. A GLB has y up.
RViz and Drake rotate it to z up on loading, and older versions of RViz ignore the root node that rotates it: either way
the mesh of a URDF is in the marker frame without further rotation. Gazebo applies no rotation, so an SDF rotates the
visual back by a quarter turn about x.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from math import pi
from typing import Self
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.exporters.meshes import MeshedPart, meshed, write_glb
from markergen.model.marker import Marker

Array = NDArray[np.float64]

DENSITY = 1240.0
"""Density of polylactide, the usual filament, in kg/m^3."""


@dataclass(frozen=True)
class Simulated:
    """Marker as a rigid body; m, kg, marker frame.

    Attributes
    ----------
    name : str
    mesh : str
        Path of the GLB, relative to the file that refers to it.
    glb : bytes
    mass : float
    center : array (3,)
        Center of mass.
    inertia : array (3, 3)
        Inertia about the center of mass.
    low, high : array (3,)
        Corners of its bounding box.
    round : bool
        True if its collision shape is a cylinder about the z axis rather than that box.
    notes : tuple of str
    """

    name: str
    mesh: str
    glb: bytes
    mass: float
    center: Array
    inertia: Array
    low: Array
    high: Array
    round: bool
    notes: tuple[str, ...]

    @classmethod
    def of(cls, markers: Sequence[Marker], options: ExportOptions, suffix: str) -> Self:
        """Make the body of a marker; raises as `meshed` does."""
        made, mesh = meshed(markers, options, suffix), f"meshes/{options.stem}.glb"
        points = np.concatenate([part.mesh.points for part in made.parts]) / 1e3
        mass, center, inertia = mass_of(made.parts)
        return cls(
            made.name,
            mesh,
            write_glb(made.parts, made.name),
            mass,
            center,
            inertia,
            points.min(axis=0),
            points.max(axis=0),
            [part.is_disk for part in made.made.parts if part.is_plate] == [True],
            (f"It shows {mesh} beside it, and weighs {mass * 1e3:.3g} g ({DENSITY:g} kg/m^3).", *made.notes),
        )

    @property
    def digest(self) -> str:
        """Digest of the GLB, to check that it is the intended one."""
        return f"sha256 {sha256(self.glb).hexdigest()}"

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
    """Write a robot of one link, accompanied by ``meshes/<stem>.glb``."""
    body = Simulated.of(markers, options, ".urdf")
    notes = (
        f"RViz finds the mesh once it is in a package, as package://<package>/{body.mesh}; for Gazebo write .sdf.",
        *body.notes,
    )
    return Output(_robot(body).encode(), notes, {body.mesh: body.glb})


def _robot(body: Simulated) -> str:
    shape, measures, middle = body.collision()
    inside = " ".join(f'{name}="{value}"' for name, value in measures.items())
    moments = " ".join(f'{name}="{value}"' for name, value in body.moments().items())
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<robot name="{body.name}">
  <link name="marker">
    <inertial>
      <origin xyz="{numbers(body.center)}" rpy="0 0 0"/>
      <mass value="{number(body.mass)}"/>
      <inertia {moments}/>
    </inertial>
    <visual>
      <origin xyz="0 0 0" rpy="0 0 0"/>
      <!-- {body.digest} -->
      <geometry><mesh filename={quoteattr(body.mesh)}/></geometry>
    </visual>
    <collision>
      <origin xyz="{numbers(middle)}" rpy="0 0 0"/>
      <geometry><{shape} {inside}/></geometry>
    </collision>
  </link>
</robot>
"""


def export_sdf(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a model of one link, accompanied by ``model.config`` and ``meshes/<stem>.glb``."""
    body = Simulated.of(markers, options, ".sdf")
    beside = {"model.config": _config(body, options.stem).encode(), body.mesh: body.glb}
    return Output(_model(body).encode(), body.notes, beside)


def _model(body: Simulated) -> str:
    shape, measures, middle = body.collision()
    inside = "".join(f"<{name}>{value}</{name}>" for name, value in measures.items())
    moments = "".join(f"<{name}>{value}</{name}>" for name, value in body.moments().items())
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
      <visual name="visual">
        <pose>0 0 0 {number(pi / 2)} 0 0</pose>
        <!-- {body.digest} -->
        <geometry><mesh><uri>{escape(body.mesh)}</uri></mesh></geometry>
      </visual>
      <collision name="collision">
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
