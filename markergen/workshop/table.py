"""Outlines to cut, solids, meshes, and the drawing that goes with them; loads no writers."""

from dataclasses import replace

from markergen.exporters import EXPORTERS, RIG_EXPORTERS, Exporter

_FORMATS = "markergen.workshop.formats"
_STEP = Exporter(
    f"{_FORMATS}.solids:export_step", "solids, named and colored, in mm, to machine or to print", "solid", kernel=True
)
_OF_BOTH = {
    ".brep": Exporter(f"{_FORMATS}.solids:export_brep", "the same for Open CASCADE", "solid", kernel=True),
    ".stl": Exporter(
        f"{_FORMATS}.meshes:export_stl", "mesh in mm, all in one, and one more for each material", "solid"
    ),
    ".3mf": Exporter(f"{_FORMATS}.meshes:export_3mf", "mesh with materials, for slicers", "solid"),
    ".glb": Exporter(f"{_FORMATS}.meshes:export_glb", "mesh with materials, in m, to look at", "solid"),
    ".sdf": Exporter(f"{_FORMATS}.simulators:export_sdf", "model for Gazebo, with its meshes", "solid"),
    ".mjcf.xml": Exporter(f"{_FORMATS}.simulators:export_mjcf", "model for MuJoCo, with its meshes", "solid"),
    ".urdf": Exporter(
        f"{_FORMATS}.simulators:export_urdf", "model for ROS and other simulators, with its meshes", "solid"
    ),
}

EXPORTERS.register(".dxf")(
    Exporter(f"{_FORMATS}.dxf:export", "to cut and engrave, R2010 in mm; see --process laser", "flat")
)
EXPORTERS.register(".step", ".stp")(_STEP)
RIG_EXPORTERS.register(".step", ".stp")(
    replace(_STEP, description="solids, named and colored, in mm: plates, or one body")
)
for suffix, exporter in _OF_BOTH.items():
    EXPORTERS.register(suffix)(exporter)
    RIG_EXPORTERS.register(suffix)(exporter)
EXPORTERS.register(".fab.pdf")(
    Exporter(f"{_FORMATS}.fab_pdf:export", "drawing with dimensions and a table of the dots, for the workshop", "solid")
)
RIG_EXPORTERS.register(".fab.pdf")(
    Exporter(
        f"{_FORMATS}.fab_pdf:export_rig",
        "drawing of the whole with its faces' relation, then of each face, for the workshop",
        "solid",
    )
)
