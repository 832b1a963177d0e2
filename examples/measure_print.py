"""Measure a print by photographs: here a simulated one, off by 0.1 mm, 0.3 % longer along x and bent by 0.5 mm.

python examples/measure_print.py marker.json print
"""

import sys
from pathlib import Path

import cv2
import numpy as np

import markergen as mg
from markergen.maths.rotation import exponential, rotation_z
from markergen.render import Optics, render_view
from markergen.validation.print_error import displaced

CAMERA = mg.Camera(640, 480, 800, 800, 319.5, 239.5)


def main(marker: Path, folder: Path) -> None:
    """Print the marker badly, photograph it from 20 sides, measure it, and write marker and report."""
    rng, design = np.random.default_rng(1), mg.Marker.load(marker)
    x, y, _ = design.xyz.T
    off = np.column_stack([0.003 * x, 0 * y, 5e-4 * (1 - (x**2 + y**2) / 0.15**2)])
    off[:, :2] += rng.normal(0, 1e-4, (len(design), 2))
    printed = displaced(design, off)
    photos = folder / "photos"
    photos.mkdir(parents=True, exist_ok=True)
    CAMERA.save(folder / "camera.yaml")
    for k in range(20):
        lean = np.deg2rad(15 + 2 * k) * np.array([np.cos(2.4 * k), np.sin(2.4 * k), 0])
        rotation = rotation_z(1.6 * k) @ exponential(lean) @ np.diag([1.0, -1.0, -1.0])
        image = render_view(printed, CAMERA, rotation, np.array([0.01, 0, 0.6 + 0.02 * k]), Optics(), rng)
        cv2.imwrite(str(photos / f"{k:02}.png"), image)
    calibration = mg.calibrate(design, photos, CAMERA, save=[folder / "measured.json", folder / "calibration.html"])
    print(calibration)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:] or ["marker.json", "print"]))
