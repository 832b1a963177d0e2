"""Rigs as solids and meshes, and for simulators: by the same exporters as markers."""

from dataclasses import replace

from markergen.exporters import EXPORTERS, RIG_EXPORTERS

RIG_EXPORTERS.register(".step", ".stp")(
    replace(EXPORTERS[".step"], description="solids, named and colored, in mm: plates, or one body")
)
for suffix in (".brep", ".stl", ".3mf", ".glb", ".sdf", ".mjcf.xml", ".urdf"):
    RIG_EXPORTERS.register(suffix)(EXPORTERS[suffix])
