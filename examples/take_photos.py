"""Take photos of a marker that nobody had to print: synthetic ones, in clutter, through a lens with distortion.

python examples/take_photos.py marker.json photos
markergen detect photos/ --marker marker.json --camera photos/camera.yaml --overlay seen
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from markergen.model.camera import Camera, Distortion
from markergen.model.marker_json import read_marker
from markergen.model.poses import paper
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS

CAMERA = Camera(640, 480, 800, 800, 320, 240, Distortion("radtan", (-0.28, 0.09, 0.001, -0.0005, 0.0)))
POSES = (10, 130, 190, 250, 330, 395)


def main(marker_file: Path, folder: Path) -> None:
    """Write six photos, each from another pose, and the camera's calibration as ROS has it."""
    marker, poses = read_marker(marker_file), paper()
    folder.mkdir(parents=True, exist_ok=True)
    for k in POSES:
        rng = np.random.default_rng(k)
        scenery = Scenery(BACKGROUNDS["clutter"](CAMERA, rng))
        image = render_view(marker, CAMERA, poses.rotation[k], poses.translation[k], Optics(), rng, scenery)
        cv2.imwrite(str(folder / f"photo-{k:03d}.png"), image)
    (folder / "camera.yaml").write_text(
        f"image_width: {CAMERA.width}\nimage_height: {CAMERA.height}\ncamera_name: example\n"
        f"camera_matrix: {{rows: 3, cols: 3, data: {CAMERA.matrix.ravel().tolist()}}}\n"
        "distortion_model: plumb_bob\n"
        f"distortion_coefficients: {{rows: 1, cols: 5, data: {list(CAMERA.distortion.coefficients)}}}\n"
    )
    print(f"wrote {len(POSES)} photos and camera.yaml to {folder}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("marker", type=Path, nargs="?", default=Path("marker.json"))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("photos"))
    arguments = parser.parse_args()
    main(arguments.marker, arguments.folder)
