"""URDF: the marker as a robot of one link whose frame is the marker frame.

RViz and Drake turn a GLB's y up into z up when they load it, and older versions of RViz ignore the root node that turns
it: either way the mesh is in the marker frame as it stands. Gazebo does neither; it has the SDF.
"""

from collections.abc import Sequence
from xml.sax.saxutils import quoteattr

from markergen.exporters import ExportOptions, Output
from markergen.exporters.simulator import Simulated, number, numbers
from markergen.model.marker import Marker


def export(markers: Sequence[Marker], options: ExportOptions) -> Output:
    """Write a robot of one link; beside it ``meshes/<stem>.glb``."""
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
