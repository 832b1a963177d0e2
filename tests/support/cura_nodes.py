"""What Cura's reader makes of a 3MF, as JSON; meshes as STL in a folder. Run by the Python that Cura is installed for.

The reader is Cura's own, with its nodes, transforms and libSavitar. The application around it (window, machine,
extruders) is replaced. Places are in mm with z up, from the middle of the bed.
"""

import importlib.util
import json
import os
import struct
import sys
from pathlib import Path
from unittest.mock import MagicMock

os.environ["QT_QPA_PLATFORM"] = "offscreen"

import numpy as np
from cura.CuraApplication import CuraApplication
from cura.Machines.ContainerTree import ContainerTree
from cura.Settings.ExtruderManager import ExtruderManager
from UM.Application import Application
from UM.Settings.ContainerRegistry import ContainerRegistry

READER = "/usr/lib/cura/plugins/3MFReader/ThreeMFReader.py"


def reader():
    application, extruders, registry = MagicMock(), MagicMock(), MagicMock()
    application.getGlobalContainerStack.return_value.getProperty.return_value = 0
    extruders.getExtruderStack.side_effect = lambda number: MagicMock(getId=lambda: str(number))
    registry.findContainerStacks.return_value = []
    for kind, one in (
        (Application, application), (CuraApplication, application), (ExtruderManager, extruders),
        (ContainerRegistry, registry), (ContainerTree, MagicMock()),
    ):  # fmt: skip
        kind.getInstance = classmethod(lambda *_, one=one, **__: one)
    spec = importlib.util.spec_from_file_location("ThreeMFReader", READER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.ThreeMFReader()


def told(node, folder):
    results = {
        "name": node.getName(),
        "group": bool(node.callDecoration("isGroup")),
        "extruder": int(node.callDecoration("getActiveExtruder")),
        "sunk": node.callDecoration("getZOffset"),
        "children": [told(child, folder) for child in node.getChildren()],
    }
    if node.getMeshData() is not None:
        mesh = node.getMeshData().getTransformed(node.getWorldTransformation())
        x, up, front = mesh.getVertices().T
        corners = np.stack([x, -front, up], axis=-1).reshape(-1, 3, 3).astype("<f4")
        facets = np.zeros(len(corners), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
        facets["c"] = corners
        (folder / f"{results['name']}.stl").write_bytes(bytes(80) + struct.pack("<I", len(facets)) + facets.tobytes())
        results["box"] = [corners.min(axis=(0, 1)).tolist(), corners.max(axis=(0, 1)).tolist()]
    return results


print(json.dumps([told(node, Path(sys.argv[2])) for node in reader()._read(sys.argv[1])]))
