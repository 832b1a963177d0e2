"""Solids, meshes, and the drawing that goes with them."""

from markergen.exporters import EXPORTERS, Exporter

EXPORTERS.register(".step", ".stp")(
    Exporter(
        "markergen.exporters.solids:export_step",
        "solids, named and colored, in mm, to machine or to print",
        holds="solid",
        kernel=True,
    )
)
EXPORTERS.register(".brep")(
    Exporter("markergen.exporters.solids:export_brep", "the same for Open CASCADE", holds="solid", kernel=True)
)
EXPORTERS.register(".stl")(
    Exporter(
        "markergen.exporters.meshes:export_stl",
        "mesh in mm, all in one, and one more for each material",
        holds="solid",
    )
)
EXPORTERS.register(".3mf")(
    Exporter("markergen.exporters.meshes:export_3mf", "mesh with materials, for slicers", holds="solid")
)
EXPORTERS.register(".glb")(
    Exporter("markergen.exporters.meshes:export_glb", "mesh with materials, in m, to look at", holds="solid")
)
EXPORTERS.register(".sdf")(
    Exporter(
        "markergen.exporters.simulators:export_sdf",
        "model for Gazebo, with its meshes",
        holds="solid",
    )
)
EXPORTERS.register(".mjcf.xml")(
    Exporter(
        "markergen.exporters.simulators:export_mjcf",
        "model for MuJoCo, with its meshes",
        holds="solid",
    )
)
EXPORTERS.register(".urdf")(
    Exporter(
        "markergen.exporters.simulators:export_urdf",
        "model for ROS and other simulators, with its meshes",
        holds="solid",
    )
)
EXPORTERS.register(".fab.pdf")(
    Exporter(
        "markergen.exporters.fab_pdf:export",
        "drawing with dimensions and a table of the dots, for the workshop",
        holds="solid",
    )
)
