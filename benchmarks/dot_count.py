"""What `--n auto` chooses, promises and keeps, beside five dots: three rooms, three cameras, prints good to 0.1 mm.

    python -m benchmarks.dot_count                           25 views each, minutes
    python -m benchmarks.dot_count --rooms disk --cameras paper --views 100

Promised is the RMS rotation error of image and print over the poses that are rendered, kept that of the detected poses.
Views are found through the whole detection, with dots misprinted anew in each.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time

import numpy as np

from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import angle_between
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.spec import AUTO, USUAL_PRINT, Spec
from markergen.optimize.design import design
from markergen.validation.bounds import budget_of
from markergen.validation.metrics import rms
from markergen.validation.views import SyntheticViews

ROOMS: dict[str, Boundary] = {
    "disk": Circle(0.15),
    "rectangle": polygon_from([np.array([[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])]),
    "L": polygon_from([np.array([[0, 0], [0.2, 0], [0.2, 0.08], [0.08, 0.08], [0.08, 0.2], [0, 0.2]])]),
}
CAMERAS = {
    "paper": PAPER_CAMERA,
    "hd": Camera(1920, 1080, 1500.0, 1500.0, 959.5, 539.5),
    "lens": Camera(1280, 960, 1000.0, 1000.0, 639.5, 479.5, Distortion("radtan", (-0.25, 0.08, 0.0, 0.0))),
}
HEADINGS = "room       camera   n      dot  gap mm  promised   kept deg  found  wrong  ms a view  CPU s of the design"


def main() -> None:
    """Design, render and detect for every room and camera."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", nargs="*", choices=list(ROOMS), default=list(ROOMS))
    parser.add_argument("--cameras", nargs="*", choices=list(CAMERAS), default=list(CAMERAS))
    parser.add_argument("--views", type=int, default=25)
    parser.add_argument("--restarts", type=int, default=1)
    options = parser.parse_args()
    print(HEADINGS)
    for camera in options.cameras:
        for room in options.rooms:
            for n in (AUTO, 5):
                asked = {"dot": "auto", "print_sigma": USUAL_PRINT} if n else {"restarts": options.restarts}
                spec = Spec(n=n, boundary=ROOMS[room], camera=CAMERAS[camera], **asked)
                print(f"{room:10s} {camera:6s} {row(spec, options.views)}", flush=True)


def row(spec: Spec, count: int) -> str:
    """What is designed, promised and kept for one spec."""
    begin = time.process_time()
    found = design(spec)
    seconds = time.process_time() - begin
    marker, poses = found.marker, found.setting.poses
    series = SyntheticViews(marker, spec.camera, poses, count, errors=ErrorSources(USUAL_PRINT))
    off, seen, wrong, spent = list[float](), list[int](), 0, 0.0
    for k in range(count):
        begin = time.process_time()
        view = series.take(k)
        spent += time.process_time() - begin
        wrong += view.wrong
        if view.detected and view.detection.pose is not None:
            seen.append(view.pose)
            off.append(float(np.rad2deg(angle_between(view.detection.pose.rotation, poses.rotation[view.pose]))))
    promised = rms(budget_of(series).rotation_deg["total"][seen])
    gap = marker.provenance["spec"].get("gap", 0.0)
    return (
        f"{len(marker):4d} {1e3 * marker.dot_diameter:5.1f} {1e3 * gap:7.1f} {promised:9.4f} "
        f"{rms(np.array(off)):10.4f} "
        f"{len(seen):3d}/{count} {wrong:4d} {1e3 * spent / count:9.0f} {seconds:13.1f}"
    )


if __name__ == "__main__":
    main()
