"""Rigs as solids and meshes, and for simulators: by the same functions as markers."""

from markergen.exporters import RIG_EXPORTERS, Exporter

RIG_EXPORTERS.register(".step", ".stp")(
    Exporter(
        "markergen.exporters.solids:export_step",
        "solids, named and colored, in mm: plates, or one body",
        holds="solid",
        kernel=True,
    )
)
RIG_EXPORTERS.register(".brep")(
    Exporter("markergen.exporters.solids:export_brep", "the same for Open CASCADE", holds="solid", kernel=True)
)
RIG_EXPORTERS.register(".stl")(
    Exporter(
        "markergen.exporters.meshes:export_stl",
        "mesh in mm, all in one, and one more for each material",
        holds="solid",
    )
)
RIG_EXPORTERS.register(".3mf")(
    Exporter("markergen.exporters.meshes:export_3mf", "mesh with materials, for slicers", holds="solid")
)
RIG_EXPORTERS.register(".glb")(
    Exporter("markergen.exporters.meshes:export_glb", "mesh with materials, in m, to look at", holds="solid")
)
RIG_EXPORTERS.register(".sdf")(
    Exporter("markergen.exporters.simulators:export_sdf", "model for Gazebo, with its meshes", holds="solid")
)
RIG_EXPORTERS.register(".mjcf.xml")(
    Exporter("markergen.exporters.simulators:export_mjcf", "model for MuJoCo, with its meshes", holds="solid")
)
RIG_EXPORTERS.register(".urdf")(
    Exporter(
        "markergen.exporters.simulators:export_urdf",
        "model for ROS and other simulators, with its meshes",
        holds="solid",
    )
)
