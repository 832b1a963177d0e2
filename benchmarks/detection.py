"""CPU time of detection per frame beside ArUco, AprilTag and OpenCV's circle grids, on the same scenes; one thread.

    python -m benchmarks.detection [--sizes 640x480 1920x1080 4000x3000] [--photos FOLDER] [--json F] [--against F]

Markers, tags and grids stand in the same disk, in the same poses, before the same photographs, and every detector takes
its turn on every frame. A wrong result has a wrong label or number (grids of OpenCV are often mirrored). Errors are
those of dots or corners.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import inspect
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks import detection_scenes as scenes
from benchmarks.detection_photos import GRIDS, add_photos, labeled, photos
from benchmarks.detection_scenes import Image, Rows
from benchmarks.loading import seconds
from markergen.arrays import Array
from markergen.maths.rotation import exponential
from markergen.model.camera import Camera
from markergen.model.tag import Tag
from markergen.render import Optics, Patch, Scenery, circle, render_patches

VIEWS = {"640x480": 20, "1920x1080": 10, "4000x3000": 5}
TIMES = 3
GRID = (5, 4)
ARUCO = Tag("aruco:DICT_4X4_50", 7, np.sqrt(2) * scenes.RADIUS * 6 / 8)
APRILTAG = Tag("apriltag:36h11", 7, np.sqrt(2) * scenes.RADIUS * 8 / 10)
FAR_PX = 5.0

Sight = tuple[Sequence[int], Array] | None
"""Labels (k,) and pixels (k, 2) that a detector has, or None."""


@dataclass
class Score:
    """What a detector did in a series of frames."""

    frames: int = 0
    found: int = 0
    wrong: int = 0
    errors: list[Array] = field(default_factory=list)
    times: list[float] = field(default_factory=list)

    def run(self, detect: Callable[[], Sight], truth: Array | None, times: int = TIMES) -> None:
        """Time a detector on a frame; the first run on each is a warm-up."""
        seen = detect()
        for _ in range(times):
            start = time.process_time()
            detect()
            self.times.append(time.process_time() - start)
        self.frames += 1
        self.found += seen is not None
        if seen is None:
            return
        error = np.full(1, np.inf) if truth is None else np.linalg.norm(seen[1] - truth[list(seen[0])], axis=-1)
        self.wrong += bool(error.max() > FAR_PX)
        self.errors += [error] if error.max() <= FAR_PX else []

    def row(self) -> dict[str, Any]:
        error = np.concatenate([*self.errors, np.zeros(0)])
        return {
            "frames": self.frames, "found": self.found, "wrong": self.wrong,
            "median px": float(np.median(error)) if len(error) else np.nan,
            "95 % px": float(np.quantile(error, 0.95)) if len(error) else np.nan,
            "CPU ms": 1e3 * float(np.median(self.times)), "95 % ms": 1e3 * float(np.quantile(self.times, 0.95)),
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", nargs="*", default=list(VIEWS), help="of images")
    parser.add_argument("--views", type=int, help="of each size")
    add_photos(parser)
    parser.add_argument("--json", help="where to write the results")
    parser.add_argument("--against", help="results of an earlier run, to show both")
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)
    before, folder = scenes.load_run(options.against), photos(options.photos)

    def show(title: str, rows: Rows) -> None:
        scenes.print_table(title, rows, before.get(title))
        scenes.save_run(options.json, {title: rows})

    show("import and first call", starts())
    if folder is None:
        print("photographs skipped: no folder given, and none in MARKERGEN_PHOTOS\n")
    else:
        show("photographs", photographs(folder))
    for size in options.sizes:
        width, height = map(int, size.split("x"))
        show(size, rendered(scenes.camera_of(width, height), options.views or VIEWS.get(size, 5)))


def rendered(camera: Camera, views: int) -> Rows:
    """Every detector on its own mark in the same disk, poses and backgrounds."""
    ring, plain = scenes.ring_marker(), scenes.random_marker(scenes.PLAIN, ringed=False, seed=1)
    detectors = {"ring": mg.Detector(ring, camera), "no ring": mg.Detector(plain, camera)}
    arucos, apriltags = aruco(), apriltag()
    scores = dict[str, Score]()
    for k in range(views):
        rng = np.random.default_rng([k, 0])
        placed = scenes.pose(camera, rng)
        behind = scenes.background("photo", camera, rng)
        for name, marker in (("ring", ring), ("no ring", plain)):
            scene = scenes.view(marker, camera, placed, np.random.default_rng([k, 1]), Optics(), behind)
            detector, image = detectors[name], scene.image
            score(scores, f"markergen, {name}").run(partial(ours, detector, image), scene.pixels)
            track(scores, f"markergen, {name}, tracking", detector, scene, behind, k)
            if name == "ring":
                empty = render_patches([], camera, *placed, Optics(), np.random.default_rng([k, 2]), Scenery(behind))
                score(scores, "markergen, no marker there").run(partial(ours, detector, empty), None)
        for tag, peers in ((ARUCO, arucos), (APRILTAG, apriltags)):
            image, corners = tag_scene(tag, camera, placed, behind, k)
            for label, detect in peers.items():
                score(scores, label).run(partial(detect, image), corners)
        image, centers = grid_scene(camera, placed, behind, k)
        score(scores, "cv2.findCirclesGrid").run(partial(circles_grid, image, centers), centers)
    return {name: each.row() for name, each in scores.items()}


def score(scores: dict[str, Score], label: str) -> Score:
    return scores.setdefault(label, Score())


def ours(detector: Any, image: Image, **options: Any) -> Sight:
    hits = [each for each in detector(image, **options) if each.ok]
    return (hits[0].ids.tolist(), hits[0].pixels) if hits else None


def track(scores: dict[str, Score], label: str, detector: Any, scene: scenes.Scene, behind: Any, k: int) -> None:
    """Time the frame after a scene, in which the marker has moved by about a percent of the distance and a degree."""
    if "near" not in inspect.signature(detector.__call__).parameters:
        return
    previous = detector(scene.image)
    rng = np.random.default_rng([k, 3])
    turned = exponential(rng.normal(0, 0.01, 3)) @ scene.rotation
    moved = turned, scene.translation + rng.normal(0, 0.01, 3) * scene.translation[2]
    after = scenes.view(scene.marker, scene.camera, moved, rng, Optics(), behind)
    score(scores, label).run(partial(ours, detector, after.image, near=previous), after.pixels)


def aruco() -> dict[str, Callable[[Image], Sight]]:
    """Return ArUco's detector without refinement of corners, and with that to subpixels."""

    def detector(refinement: int) -> Callable[[Image], Sight]:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = refinement
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        engine = cv2.aruco.ArucoDetector(dictionary, parameters)

        def detect(image: Image) -> Sight:
            corners, ids, _ = engine.detectMarkers(image)
            return _tag_sight([(int(i), c[0]) for i, c in zip(np.ravel(ids), corners, strict=True)] if corners else [])

        return detect

    return {
        "cv2.aruco, no refinement": detector(cv2.aruco.CORNER_REFINE_NONE),
        "cv2.aruco, subpixel": detector(cv2.aruco.CORNER_REFINE_SUBPIX),
    }


@cache
def apriltag() -> dict[str, Callable[[Image], Sight]]:
    """Return AprilTag's own detector, if it is installed; its pixels have their origin at a corner of the image."""
    try:
        from pupil_apriltags import Detector as Engine  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        return {}
    # Its destructor crashes now and then.
    del Engine.__del__
    # Shrunk by two, its default; the full image takes three times as long and is more accurate.
    engines = {f"pupil-apriltags, quad_decimate={n}": Engine("tag36h11", nthreads=1, quad_decimate=n) for n in (2, 1)}

    def detector(engine: Any) -> Callable[[Image], Sight]:
        return lambda image: _tag_sight([(e.tag_id, e.corners[[1, 0, 3, 2]] - 0.5) for e in engine.detect(image)])

    return {name: detector(engine) for name, engine in engines.items()}


def _tag_sight(tags: list[tuple[int, Array]]) -> Sight:
    """Return the corners of the tag that is there; of another number as a wrong one."""
    right = [corners for number, corners in tags if number == ARUCO.id]
    if right:
        return range(4), right[0]
    return (range(4), np.full((4, 2), 1e6)) if tags else None


def tag_scene(tag: Tag, camera: Camera, placed: tuple[Array, Array], behind: Any, k: int) -> tuple[Image, Array]:
    plate = Patch((circle(np.zeros(3), scenes.RADIUS),), 1.0)
    ink = Patch(tuple(np.pad(outline, ((0, 0), (0, 1))) for outline in tag.outlines), 0.0)
    rng = np.random.default_rng([k, 4])
    image = render_patches([plate, ink], camera, *placed, Optics(), rng, Scenery(behind))
    corners = np.pad(tag.corners, ((0, 0), (0, 1)))
    return image, camera.project(corners, placed[0][None], placed[1][None])[0]


def grid_scene(camera: Camera, placed: tuple[Array, Array], behind: Any, k: int) -> tuple[Image, Array]:
    columns, rows = GRID
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, (rows - 1) / 2 - np.arange(rows))
    places = 0.045 * np.stack([x.ravel(), y.ravel(), np.zeros(columns * rows)], axis=-1)
    plate = Patch((circle(np.zeros(3), scenes.RADIUS),), 1.0)
    dots = [Patch((circle(place, 0.0125),), 0.0) for place in places]
    rng = np.random.default_rng([k, 5])
    image = render_patches([plate, *dots], camera, *placed, Optics(), rng, Scenery(behind))
    return image, camera.project(places, placed[0][None], placed[1][None])[0]


def circles_grid(image: Image, truth: Array) -> Sight:
    """Return OpenCV's grid in the order of two that is nearer the truth, since it looks the same after half a turn."""
    ok, centers = cv2.findCirclesGrid(image, GRID, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
    if not ok:
        return None
    centers = np.asarray(centers, dtype=float).reshape(-1, 2)
    turned = np.linalg.norm(centers[::-1] - truth, axis=-1).max() < np.linalg.norm(centers - truth, axis=-1).max()
    return range(len(centers)), centers[::-1] if turned else centers


def photographs(folder: Path) -> Rows:
    """CPU time in labeled photographs: our markers, our dots, and ArUco, which has nothing to find there."""
    rows: Rows = {}
    for kind in (*GRIDS, "random_dots"):
        files = sorted((folder / kind).glob("marker*.json"))
        lens = folder / kind / "camera.yaml"
        detector, peer = mg.Detector(files, lens if lens.exists() else None), aruco()["cv2.aruco, subpixel"]
        calls: dict[str, Callable[[Image], Any]] = {"markers": detector, "dots": detector.dots, "aruco": peer}
        times: dict[str, list[float]] = {name: [] for name in calls}
        for path, _ in labeled(folder / kind):
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            for name, call in calls.items():
                spent = Score()
                spent.run(partial(_no_sight, call, image), None, times=1)
                times[name] += spent.times
        rows[kind] = {f"{name} ms": 1e3 * float(np.median(spent)) for name, spent in times.items()}
    return rows


def _no_sight(call: Callable[[Image], Any], image: Image) -> None:
    call(image)


def starts() -> Rows:
    """CPU time of a fresh interpreter that imports and detects once, beside ArUco's."""
    camera = scenes.camera_of(640, 480)
    scene = scenes.view(
        scenes.ring_marker(), camera, scenes.pose(camera, np.random.default_rng(0)), np.random.default_rng(0)
    )
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        cv2.imwrite(str(home / "view.png"), scene.image)
        scene.marker.save(home / "marker.json")
        read = f"import cv2; image = cv2.imread({str(home / 'view.png')!r}, 0)"
        made = f"Camera(640, 480, {camera.fx!r}, {camera.fy!r}, {camera.cx!r}, {camera.cy!r})"
        engine = "cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))"
        codes = {
            "import cv2, read an image": read,
            "cv2.aruco": f"{read}; {engine}.detectMarkers(image)",
            "markergen": f"{read}; import markergen as mg; from markergen.model.camera import Camera; "
            f"assert mg.Detector({str(home / 'marker.json')!r}, {made})(image)[0].ok",
        }
        times = [{name: seconds(code, folder) for name, code in codes.items()} for _ in range(5)]
    # The first of them compiles to bytecode.
    return {name: {"CPU s": min(each[name] for each in times[1:])} for name in codes}


if __name__ == "__main__":
    main()
