"""Make a marker as solids: a milled plate with mounting holes and inlays, with its drawing; then check the files.

python examples/marker_to_step.py marker.step
"""

import argparse
from pathlib import Path

import markergen as mg


def main(path: Path) -> None:
    """Design six dots, write STEP and fabrication sheet, and read the STEP back."""
    marker = mg.design(n=6, radius="80mm", dot="16mm", mount="4xM4c@190mm", edge="22mm").marker
    sheet = path.with_suffix(".fab.pdf")
    for file in marker.save(path, sheet, process="cnc", thickness="6mm", chamfer="1mm", tool="3mm"):
        print(file)
    verification = mg.verify(marker, path)
    print(verification)
    if not verification.passed:
        raise SystemExit(1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("marker.step"))
    main(parser.parse_args().path)
