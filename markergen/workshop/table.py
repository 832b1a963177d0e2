"""Outlines to cut, solids, meshes, and the drawing that goes with them; loads no writers."""
# tests: tests/contracts/test_exporters.py

from dataclasses import replace

from markergen.exporters import EXPORTERS, Exporter

_FORMATS = "markergen.workshop.formats"


def _solid(write: str, description: str, rig_description: str = "", kernel: bool = False) -> Exporter:
    return Exporter(
        f"{_FORMATS}.{write}", description, "solid", kernel=kernel, rig_description=rig_description or description
    )


EXPORTERS.register(".dxf")(
    Exporter(f"{_FORMATS}.dxf:export_dxf", "to cut and engrave, R2010 in mm; see --process laser", "flat")
)
EXPORTERS.register(".step", ".stp")(
    _solid(
        "solids:export_step",
        "solids, named and colored, in mm, to machine or to print",
        "solids, named and colored, in mm: plates, or one body",
        kernel=True,
    )
)
EXPORTERS.register(".brep")(_solid("solids:export_brep", "the same for Open CASCADE", kernel=True))
EXPORTERS.register(".stl")(_solid("meshes:export_stl", "mesh in mm, all in one, and one more for each material"))
EXPORTERS.register(".3mf")(_solid("meshes:export_3mf", "mesh with materials, for slicers"))
EXPORTERS.register(".glb")(
    replace(
        _solid("meshes:export_glb", "mesh with materials, in m, to look at"),
        parts="markergen.workshop.mesh:parts_to_mesh",
    )
)
EXPORTERS.register(".sdf")(_solid("simulators:export_sdf", "model for Gazebo, with its meshes"))
EXPORTERS.register(".mjcf.xml")(_solid("simulators:export_mjcf", "model for MuJoCo, with its meshes"))
EXPORTERS.register(".urdf")(_solid("simulators:export_urdf", "model for ROS and other simulators, with its meshes"))
EXPORTERS.register(".fab.pdf")(
    _solid(
        "fab_pdf:export_fab_pdf",
        "drawing with dimensions and a table of the dots, for the workshop",
        "drawing of the whole with its faces' relation, then of each face, for the workshop",
    )
)
