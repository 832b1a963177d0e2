"""Design a marker, see its expected accuracy, and save it as a sheet, as a cutting drawing, and for OpenCV.

python examples/design_and_save.py out
"""

import argparse
from pathlib import Path

import markergen as mg


def main(folder: Path) -> None:
    """Design eight dots on an A4 sheet for a camera at 0.5 to 2 m, and write four files."""
    folder.mkdir(parents=True, exist_ok=True)
    design = mg.design(n=8, boundary="rect:170mmx170mm", dot="18mm", poses="cone:distance=0.5..2m,tilt=0..60")
    print(design)
    marker = folder / "marker"
    for file in design.marker.save(
        f"{marker}.pdf", f"{marker}.dxf", f"{marker}.opencv.yaml", f"{marker}.json", paper="A4"
    ):
        print(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("out"))
    main(parser.parse_args().folder)
