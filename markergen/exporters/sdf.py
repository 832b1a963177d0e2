"""SDF: the marker as a model folder for Gazebo and other simulators, in the marker frame.

Gazebo takes a GLB as it comes, with y up, so that the visual is turned back by a quarter about x.
"""

from collections.abc import Sequence
from math import pi
from xml.sax.saxutils import escape

import markergen
from markergen.exporters import ExportOptions, Output
from markergen.exporters.simulator import Simulated, number, numbers
from markergen.model.marker import Marker


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a model of one link; beside it ``model.config`` and ``meshes/<stem>.glb``."""
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
