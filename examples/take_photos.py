"""Take synthetic photos of a marker, without printing it, in clutter and through a lens with distortion.

python examples/take_photos.py marker.json photos
markergen detect photos/ --marker marker.json --camera photos/camera.yaml --overlay seen
"""

import sys
from pathlib import Path

import cv2
import numpy as np

import markergen as mg
from markergen.model.poses import paper
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS

CALIBRATION = """{image_width: 640, image_height: 480, distortion_model: plumb_bob,
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]},
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.09, 0.001, -0.0005, 0.0]}}
"""
POSES = (10, 130, 190, 250, 330, 395)


def main(marker: Path, folder: Path) -> None:
    """Write six photos, each from a different pose, and the camera's calibration in ROS format."""
    result, poses = mg.Marker.load(marker), paper()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "camera.yaml").write_text(CALIBRATION)
    camera = mg.Camera.load(folder / "camera.yaml")
    for k, rng in ((k, np.random.default_rng(k)) for k in POSES):
        scenery = Scenery(BACKGROUNDS["clutter"](camera, rng))
        image = render_view(result, camera, poses.rotation[k], poses.translation[k], Optics(), rng, scenery)
        cv2.imwrite(str(folder / f"photo-{k:03d}.png"), image)
    print(f"wrote {len(POSES)} photos and camera.yaml to {folder}")


if __name__ == "__main__":
    paths = sys.argv[1:] or ["marker.json", "photos"]
    main(*map(Path, paths)) if len(paths) == 2 else sys.exit(__doc__)
