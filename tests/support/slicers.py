"""Markers sliced by programs that people print with, and what their G-code prints where."""

import json
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from programs import program

LAYER = 0.2
"""mm."""

WIDTH = 0.45
"""Maximum width of a printed line, mm."""

MIDDLE = 100.0
"""Where the marker's origin is on the bed of PrusaSlicer, in mm along x and y."""

SETTINGS = f"""\
nozzle_diameter = 0.4,0.4
filament_diameter = 1.75,1.75
temperature = 200,200
first_layer_temperature = 200,200
layer_height = {LAYER}
first_layer_height = {LAYER}
skirts = 0
"""

DEFINITIONS = Path("/usr/share/cura/resources/definitions")

NO_PART = {"Custom", "Skirt", "Skirt/Brim", "SKIRT", "PRIME-TOWER", "Wipe tower"}


@dataclass(frozen=True)
class Lines:
    """Printed lines: number of the extruder from 0; both ends (n, 2, 2) and the layer's height, in mm, marker frame."""

    extruder: np.ndarray
    ends: np.ndarray
    top: np.ndarray

    def extruder_at(self, places: np.ndarray, top: float) -> np.ndarray:
        """Extruder of the line of a layer that is nearest to each place (m, 2)."""
        mine = np.abs(self.top - top) < 1e-3
        start, along = self.ends[mine, 0], self.ends[mine, 1] - self.ends[mine, 0]
        offset = places[:, None] - start
        share = np.clip((offset * along).sum(axis=-1) / (along**2).sum(axis=-1), 0, 1)
        away = np.linalg.norm(offset - share[..., None] * along, axis=-1)
        assert away.min(axis=1).max() < WIDTH
        return self.extruder[mine][away.argmin(axis=1)]


def lines_of(gcode: str, origin: tuple[float, float, float]) -> Lines:
    """Read absolute moves that extrude; the marker's origin is at `origin`."""
    at, extruder, kind, result = {"X": 0.0, "Y": 0.0, "Z": 0.0, "E": 0.0}, 0, "", []
    for line in gcode.splitlines():
        if line.startswith(";TYPE:"):
            kind = line[6:]
        elif re.fullmatch(r"T\d", line):
            extruder = int(line[1])
        elif re.match(r"G(0|1|92) ", line):
            new = at | {word[0]: float(word[1:]) for word in line.partition(";")[0].split()[1:]}
            moved = (new["X"], new["Y"]) != (at["X"], at["Y"])
            if line[:3] != "G92" and moved and new["E"] > at["E"] and kind not in NO_PART:
                result.append((extruder, at["X"], at["Y"], new["X"], new["Y"], new["Z"]))
            at = new
    table = np.array(result)
    ends = table[:, 1:5].reshape(-1, 2, 2) - origin[:2]
    return Lines(table[:, 0].astype(int), ends, np.round(table[:, 5] - origin[2], 4))


def by_prusaslicer(path: Path, lowest: float) -> Lines:
    """Slice a 3MF from the command line; it lies on the bed with its lowest height, in mm."""
    slicer = program("prusa-slicer")
    settings, gcode = path.with_suffix(".ini"), path.with_suffix(".gcode")
    settings.write_text(SETTINGS)
    run(slicer, "--load", settings, "--center", f"{MIDDLE},{MIDDLE}", "--export-gcode", "-o", gcode, path)
    return lines_of(gcode.read_text(), (MIDDLE, MIDDLE, -lowest))


def objects_of_prusaslicer(path: Path) -> list[dict[str, str]]:
    """Values that PrusaSlicer tells about each object of a 3MF."""
    text = run(program("prusa-slicer"), "--info", path)
    blocks = text.partition(f"[{path.name}]")[2].split(f"[{path.name}]")
    return [dict(re.findall(r"^(\w+) = +(.*)$", block, re.MULTILINE)) for block in blocks]


def nodes_of_cura(path: Path) -> list[dict]:
    """Nodes that Cura's reader makes of a 3MF; their meshes are written beside it."""
    program("cura")
    script = Path(__file__).with_name("cura_nodes.py")
    # The tests' own environment must not be seen by Debian's interpreter.
    bare = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    return json.loads(run("/usr/bin/python3", "-W", "ignore", script, path, path.parent, env=bare))


def by_curaengine(nodes: list[dict], folder: Path, lowest: float) -> Lines:
    """Slice meshes of Cura's nodes with their extruders; the group is lowered to the bed as a whole."""
    engine, gcode, origin = program("cura-engine", "CuraEngine"), folder / "cura.gcode", -lowest
    settings = {
        "machine_extruder_count": 2, "machine_width": 250, "machine_depth": 250, "machine_center_is_zero": "true",
        "layer_height": LAYER, "layer_height_0": LAYER, "adhesion_type": "none", "prime_tower_enable": "false",
        "mesh_position_z": origin,
    }  # fmt: skip
    command: list[object] = [engine, "slice", "-j", DEFINITIONS / "fdmprinter.def.json"]
    for key, value in settings.items():
        command += ["-s", f"{key}={value}"]
    for number in (0, 1):
        command += [f"-e{number}", "-j", DEFINITIONS / "fdmextruder.def.json", "-s", f"extruder_nr={number}"]
    for node in nodes:
        command += ["-l", folder / f"{node['name']}.stl", "-s", f"extruder_nr={node['extruder']}"]
    places = f"{DEFINITIONS}:{DEFINITIONS.with_name('extruders')}"
    run(*command, "-o", gcode, env={**os.environ, "CURA_ENGINE_SEARCH_PATH": places})
    return lines_of(gcode.read_text(), (0.0, 0.0, origin))


def run(*command: object, env: dict[str, str] | None = None) -> str:
    return subprocess.run(
        [str(part) for part in command], capture_output=True, check=True, text=True, timeout=300, env=env
    ).stdout
