"""What `--n auto` chooses, promises and keeps, beside five dots: three rooms, three cameras, prints good to 0.1 mm.

    python -m benchmarks.dot_count                           25 views each, minutes
    python -m benchmarks.dot_count --rooms disk --cameras paper --views 100
    python -m benchmarks.dot_count --rooms flange --cameras 4k --rivals circles:7x7 checkerboard:5x5 aruco:DICT_4X4_50

Promised is the RMS rotation error of image and print over the poses that are rendered, kept that of the detected poses.
Views are found through the whole detection, with dots misprinted anew in each.

With --rivals, tags and boards are compared with both as by `markergen compare`, in other views with the same print.
They are as large as the room's outline allows, whatever is kept out inside. The last line counts those that are found
in 99 % of the views, and among them those that err less than the marker of `--n auto`, or could by the photometric
bound.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.shapes import shapes
from markergen.comparison.compare import compare_and_time
from markergen.defaults import PRINT_SIGMA
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import angle_between
from markergen.model.boundary import Boundary, Circle, polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera, Distortion
from markergen.model.marker import Marker
from markergen.model.spec import AUTO, Spec
from markergen.optimize.design import design
from markergen.validation.bounds import budget_of
from markergen.validation.metrics import rms
from markergen.validation.views import SyntheticViews

Room = tuple[Boundary, tuple[Boundary, ...]]
"""Boundary and keep-outs."""

ROOMS: dict[str, Room] = {
    "disk": (Circle(0.15), ()),
    "rectangle": (polygon_from([np.array([[-0.1, -0.05], [0.1, -0.05], [0.1, 0.05], [-0.1, 0.05]])]), ()),
    "L": (polygon_from([np.array([[0, 0], [0.2, 0], [0.2, 0.08], [0.08, 0.08], [0.08, 0.2], [0, 0.2]])]), ()),
    "flange": shapes()["flange"],
}
CAMERAS = {
    "paper": PAPER_CAMERA,
    "hd": Camera(1920, 1080, 1500.0, 1500.0, 959.5, 539.5),
    "lens": Camera(1280, 960, 1000.0, 1000.0, 639.5, 479.5, Distortion("radtan", (-0.25, 0.08, 0.0, 0.0))),
    "4k": Camera(4000, 3000, 3600.0, 3600.0, 1999.5, 1499.5),
}
USUAL = ["disk", "rectangle", "L"], ["paper", "hd", "lens"]
"""Rooms and cameras unless others are asked for."""

OFTEN = 0.99
"""Share of the views in which a rival has to be found."""

HEADINGS = "room       camera   n      dot  gap mm  promised   kept deg  found  wrong  ms a view  CPU s of the design"


def main() -> None:
    """Design, render and detect for every room and camera."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", nargs="*", choices=list(ROOMS), default=USUAL[0])
    parser.add_argument("--cameras", nargs="*", choices=list(CAMERAS), default=USUAL[1])
    parser.add_argument("--views", type=int, default=25)
    parser.add_argument("--restarts", type=int, default=1)
    parser.add_argument("--rivals", nargs="*", default=[], help="as for `markergen compare`")
    options = parser.parse_args()
    print(HEADINGS)
    compared: list[dict[str, Any]] = []
    for camera in options.cameras:
        for room in options.rooms:
            boundary, keep_outs = ROOMS[room]
            designs: dict[str, Marker] = {}
            for n in (AUTO, 5):
                asked = {"dot": "auto", "print_sigma": PRINT_SIGMA} if n else {"restarts": options.restarts}
                spec = Spec(n=n, boundary=boundary, keep_outs=keep_outs, camera=CAMERAS[camera], **asked)
                line, designs[f"{n or 'auto'} dots"] = row(spec, options.views)
                print(f"{room:10s} {camera:6s} {line}", flush=True)
            if options.rivals:
                compared += beside(designs, options.rivals, options.views)
    if compared:
        print(summary(compared))


def row(spec: Spec, count: int) -> tuple[str, Marker]:
    """What is designed, promised and kept for one spec, and the marker."""
    begin = time.process_time()
    actual = design(spec)
    seconds = time.process_time() - begin
    marker, poses = actual.marker, actual.setting.poses
    series = SyntheticViews(marker, spec.camera, poses, count, errors=ErrorSources(PRINT_SIGMA))
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
    line = (
        f"{len(marker):4d} {1e3 * marker.dot_diameter:5.1f} {1e3 * gap:7.1f} {promised:9.4f} "
        f"{rms(np.array(off)):10.4f} "
        f"{len(seen):3d}/{count} {wrong:4d} {1e3 * spent / count:9.0f} {seconds:13.1f}"
    )
    return line, marker


def beside(designs: dict[str, Marker], rivals: Sequence[str], count: int) -> list[dict[str, Any]]:
    """Print how designs and rivals fare in the same views; their results, relative to the first design."""
    texts = [*designs, *rivals]
    results, cpu_s = compare_and_time(texts, count, print_sigma=PRINT_SIGMA, workers=1, given=designs)
    print("    beside                       found   RMS deg      95 % interval  ratio    bound  ms a view")
    first = results["contestants"][0]["pattern_bound"]["rotation_deg"]
    for result in results["contestants"]:
        error, ratio = result["rotation_deg"]["rms"], result["ratio"]["rotation_deg"]
        low, high = result["interval"]["rotation_deg"] or (np.nan, np.nan)
        result["bound_ratio"] = (result["pattern_bound"]["rotation_deg"] or np.nan) / first
        print(
            f"    {result['name']:<28} {result['detected']:3d}/{count} {error or np.nan:9.4f} {low:7.4f} to {high:.4f} "
            f"{ratio['rms'] if ratio else np.nan:6.2f} {result['pattern_bound']['rotation_deg'] or np.nan:8.5f} "
            f"{1e3 * cpu_s.get(result['name'], np.nan):10.0f}",
            flush=True,
        )
    return list(results["contestants"][len(designs) :])


def summary(rivals: Sequence[dict[str, Any]]) -> str:
    """How many rivals are found, and how many of them are better than the marker of `--n auto`."""
    often = [rival for rival in rivals if not rival["absent"] and rival["rate"] >= OFTEN]
    better = sum(rival["ratio"]["rotation_deg"]["rms"] < 1 for rival in often)
    could = sum(rival["bound_ratio"] < 1 for rival in often)
    return (
        f"{len(often)} of {len(rivals)} rivals found in {OFTEN:.0%} of the views; "
        f"{better} err less than --n auto, {could} could by the bound"
    )


if __name__ == "__main__":
    main()
