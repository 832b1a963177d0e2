"""Design for your own camera and working volume, and read the expected accuracy from the result.

python examples/own_camera.py marker.pdf
"""

import argparse
from pathlib import Path

import markergen as mg

VOLUME = "cone:distance=400mm..900mm,tilt=10..50,azimuth=-60..60"


def main(path: Path) -> None:
    """Design six dots in a disk of 100 mm for a 1920x1200 camera; write the sheet and its marker.json."""
    camera = mg.Camera(width=1920, height=1200, fx=1830.0, fy=1830.0, cx=959.5, cy=599.5)
    design = mg.design(n=6, radius="100mm", camera=camera, poses=VOLUME, output=path)
    print(design.summary)
    noise_px = 0.1
    degrees = noise_px * design.criteria["design"]["rotation_deg"]
    print(f"with image points good to {noise_px} px, no estimator can do better than {degrees:.2f} degrees RMS")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("own-camera.pdf"))
    main(parser.parse_args().path)
