"""Design for a camera of your own, write the sheet, and read the expected accuracy from the result.

python examples/own_camera.py marker.pdf
"""

import argparse
from pathlib import Path

from markergen.exporters import save
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.spec import Spec
from markergen.optimize.design import design


def main(path: Path) -> None:
    """Design six dots in a disk of 100 mm for a 1920x1200 camera; write the sheet and its marker.json."""
    camera = Camera(width=1920, height=1200, fx=1830.0, fy=1830.0, cx=959.5, cy=599.5)
    found = design(Spec(n=6, boundary=Circle(0.1), camera=camera, poses="paper-roll"))
    save(found.marker, [path, path.with_suffix(".json")])
    print(found.summary)
    noise_px = 0.1
    degrees = noise_px * found.criteria["design"]["rotation_deg"]
    print(f"with image points good to {noise_px} px, no estimator can do better than {degrees:.2f} degrees RMS")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("own-camera.pdf"))
    main(parser.parse_args().path)
