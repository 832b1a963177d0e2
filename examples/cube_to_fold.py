"""A cube with a marker on every face, distinguished by tags: rig.json, sheets of faces, and a net to fold and glue."""

import sys
from pathlib import Path

import markergen as mg


def main(folder: Path) -> None:
    rig = mg.rig("cube", edge="60mm", n=4, tag="aruco:DICT_4X4_50", poses="sphere:distance=0.2..0.4m,count=100")
    print(rig)
    for file in rig.rig.save(folder / "cube.json", folder / "faces.pdf", paper="A4"):
        print(file)
    for file in rig.rig.save(folder / "net.pdf", net=True):
        print(file)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
