"""CPU time of detection per frame beside ArUco, AprilTag and OpenCV's circle grids, on the same scenes; one thread.

    python -m benchmarks.detection [--only PART...] [--sizes 640x480 1280x720 1920x1080 4000x3000] [--photos FOLDER]
                                   [--frames FOLDER] [--json F] [--against F]

starts:      import and first call
photographs: labeled photographs, if there are any
sizes:       markers, tags and grids in images of each size, also with nothing to find, and tracking
bodies:      a family of 20, a cube of six faces, and a wall of six plates beside ArUco's GridBoard
worst:       frames full of what might be dots, relative to a photograph with the marker; also those of a folder
threads:     two threads that share one detector; the time is that of a clock
memory:      peak memory in images of 4000x3000, above imports and image

Markers, tags and grids stand in the same disk, in the same poses, before the same photographs, and every detector takes
its turn on every frame. A wrong result has a wrong label or number (grids of OpenCV are often mirrored). Errors are
those of dots or corners. ArUco's fast mode shrinks images to the smallest tag, 5 % of the longer side. Dots in its disk
are then not smaller than 1/128 of the longer side, 5 px of 640: detectors that can use it take this as the smallest.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks import detection_scenes as scenes
from benchmarks import rigs
from benchmarks.detection_photos import GRIDS, add_photos, labeled, photos
from benchmarks.detection_scenes import Image, Rows
from benchmarks.loading import seconds
from markergen.arrays import Array
from markergen.maths.rotation import exponential
from markergen.model.boundary import Circle
from markergen.model.camera import Camera
from markergen.model.marker import build_marker
from markergen.model.tag import Tag
from markergen.render import Optics, Patch, Scenery, circle, render_patches, render_view

VIEWS = {"640x480": 20, "1280x720": 14, "1920x1080": 10, "4000x3000": 5}
TIMES = 3
GRID = (5, 4)
ARUCO = Tag("aruco:DICT_4X4_50", 7, np.sqrt(2) * scenes.RADIUS * 6 / 8)
APRILTAG = Tag("apriltag:36h11", 7, np.sqrt(2) * scenes.RADIUS * 8 / 10)
FAR_PX = 5.0
SMALLEST_SHARE, SMALLEST_DOT_SHARE = 0.05, 1 / 128
FAMILY = 20
NEAR = (0.53, 0.58), (0, 25)
"""Distances in m and tilts in deg in which tags of a board are seen in ArUco's fast mode: it takes 32 px more than the
smallest share."""
UPRIGHT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
WALL_PITCH, LARGE = 0.34, "4000x3000"

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
    parser = scenes.parser_of(__doc__, PARTS)
    parser.add_argument("--sizes", nargs="*", default=list(VIEWS), help="of images")
    parser.add_argument("--views", type=int, help="of each size")
    parser.add_argument("--frames", type=Path, help="folder of more frames without a marker")
    add_photos(parser)
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(CORES)})
    cv2.setNumThreads(1)
    before = scenes.load_run(options.against)
    for name in scenes.chosen(options, PARTS):
        for title, rows in PARTS[name](options).items():
            scenes.print_table(title, rows, before.get(title))
            scenes.save_run(options.json, {title: rows})


def of_sizes(measure: Callable[[Camera, Any], Rows], title: str = "{}") -> Callable[[Any], dict[str, Rows]]:
    """Return the part that measures in images of each size."""

    def part(options: Any) -> dict[str, Rows]:
        tables = {}
        for size in options.sizes:
            options.count = options.views or VIEWS.get(size, 5)
            tables[title.format(size)] = measure(scenes.camera_of(*map(int, size.split("x"))), options)
        return tables

    return part


def detector_of(body: Any, camera: Any) -> Any:
    smallest = SMALLEST_DOT_SHARE * max(camera.width, camera.height)
    return mg.Detector(body, camera, symmetric="any", smallest=smallest)


@cache
def markers() -> dict[str, mg.Marker]:
    return {
        "ring": scenes.ring_marker(), "no ring": scenes.random_marker(scenes.PLAIN, ringed=False, seed=1),
        "no ring, n=24": scenes.random_marker(24, ringed=False, seed=1),
    }  # fmt: skip


def rendered(camera: Camera, options: Any) -> Rows:
    """Every detector on its own mark in the same disk, poses and backgrounds."""
    detectors = {name: detector_of(marker, camera) for name, marker in markers().items()}
    arucos, apriltags, grid = aruco(), apriltag(), detector_of(grid_marker(), camera)
    scores = dict[str, Score]()
    for k in range(options.count):
        rng = np.random.default_rng([k, 0])
        placed = scenes.pose(camera, rng)
        behind = scenes.background("photo", camera, rng)
        empty = render_patches([], camera, *placed, Optics(), np.random.default_rng([k, 2]), Scenery(behind))
        for name, marker in markers().items():
            scene = scenes.view(marker, camera, placed, np.random.default_rng([k, 1]), Optics(), behind)
            detector, image = detectors[name], scene.image
            score(scores, f"markergen, {name}").run(partial(ours, detector, image), scene.pixels)
            track(scores, f"markergen, {name}, tracking", detector, scene, behind, k)
            score(scores, f"markergen, {name}, no marker there").run(partial(ours, detector, empty), None)
        for tag, peers in ((ARUCO, arucos), (APRILTAG, apriltags)):
            image, corners = tag_scene(tag, camera, placed, behind, k)
            for label, detect in peers.items():
                score(scores, label).run(partial(detect, image), corners)
        score(scores, f"{FAST}, no tag there").run(partial(arucos[FAST], empty), None)
        image, centers = grid_scene(camera, placed, behind, k)
        for label, detect in (("markergen, grid of 20", partial(ours, grid)), ("cv2.findCirclesGrid", circles_grid)):
            score(scores, label).run(partial(half_turned, detect, image, centers), centers)
    return {name: item.row() for name, item in scores.items()}


def bodies(camera: Camera, options: Any) -> Rows:
    """A family and bodies of several plates in the poses of one marker, beside ArUco's board in the wall's places."""
    family = [scenes.random_marker(12, True, seed=1, tag=k) for k in range(FAMILY)]
    faces = enumerate(rigs.tag_cube().markers)
    scale = scenes.RADIUS / (rigs.EDGE / 2)
    cube = mg.Rig(
        tuple(
            replace(face, marker=plain_plate(k), translation=tuple(scale * np.array(face.translation)))
            for k, face in faces
        )
    )
    places = [(f"{k}", ((k % 3 - 1) * WALL_PITCH, (0.5 - k // 3) * WALL_PITCH, 0.0)) for k in range(6)]
    wall, tags = (
        mg.Rig(tuple(mg.Plate(name, made(k), UPRIGHT, place) for k, (name, place) in enumerate(places)))
        for made in (plain_plate, partial(rigs.tag_plate, 2 * scenes.RADIUS))
    )
    cases: dict[str, tuple[Any, Any, Any]] = {
        "one marker with a tag": (family[7], family[7], None), f"family of {FAMILY}": (family[7], family, None),
        "cube of six": (cube, cube, None), "wall of six": (wall, wall, None),
        "ArUco's GridBoard of six": (tags, tags, rigs.engine()), "the same, fast": (tags, tags, fast_aruco()),
    }  # fmt: skip
    detects, scores = dict[str, Callable[[Image], Sight]](), dict[str, Score]()
    for name, (_, sought, engine) in cases.items():
        detects[name] = board(tags, camera, engine) if engine else partial(ours, detector_of(sought, camera))
    for k in range(options.count):
        for name, (body, _, _) in cases.items():
            rng = np.random.default_rng([k, 6])
            rotation, translation = scenes.pose(camera, rng, *NEAR)
            behind = Scenery(scenes.background("photo", camera, rng))
            if name.startswith("cube"):
                rotation = rotation @ exponential(rng.uniform(-2, 2, 3))
            translation = translation * body.radius / scenes.RADIUS
            image = render_view(body, camera, rotation, translation, Optics(), rng, behind)
            points = rigs.corners_of(tags).reshape(-1, 3) if body is tags else body.xyz
            pixels = camera.project(points, rotation[None], translation[None])[0]
            score(scores, name).run(partial(detects[name], image), pixels)
    return relative({name: item.row() for name, item in scores.items()}, "one marker with a tag")


def plain_plate(k: int) -> mg.Marker:
    return scenes.random_marker(6, ringed=False, seed=20 + k)


def board(tags: Any, camera: Camera, engine: Any) -> Callable[[Image], Sight]:
    """Return ArUco's detection of a board, with the corners where its pose has them."""
    detect, corners = rigs.grid_board(tags, camera, engine), rigs.corners_of(tags).reshape(-1, 3)

    def sight(image: Image) -> Sight:
        pose = detect(image)
        return pose and (range(len(corners)), camera.project(corners, pose[0][None], pose[1][None])[0])

    return sight


def relative(rows: Rows, first: str) -> Rows:
    return {name: {**row, "ratio": row["CPU ms"] / rows[first]["CPU ms"]} for name, row in rows.items()}


def worst(camera: Camera, options: Any) -> Rows:
    """CPU time in frames that look full of dots, in ms and relative to a photograph with the marker."""
    rng = np.random.default_rng(8)
    behind, placed = scenes.background("photo", camera, rng), scenes.pose(camera, rng)
    frames = {name: scenes.crowd(name, camera.width, camera.height, rng) for name in scenes.CROWDS}
    detectors, rows = {name: detector_of(marker, camera) for name, marker in markers().items()}, Rows()
    paths = sorted(options.frames.glob("*.png")) if options.frames else []
    for name, detector in detectors.items():
        scene = scenes.view(markers()[name], camera, placed, rng, Optics(), behind)
        spent = milliseconds(partial(detector, scene.image), 5)
        rows.setdefault("photograph with the marker", {})[f"{name}, ms"] = spent
        for frame, image in frames.items():
            slow = milliseconds(partial(detector, image), 1)
            rows.setdefault(frame, {}).update({f"{name}, ms": slow, f"{name}, ratio": slow / spent})
        for path in paths:
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            height, width = image.shape
            slow = milliseconds(partial(detector_of(markers()[name], scenes.camera_of(width, height)), image), 1)
            title = f"{path.stem}, {width}x{height}"
            rows.setdefault(title, {}).update({f"{name}, ms": slow, f"{name}, ratio": slow / spent})
    return rows


def milliseconds(call: Callable[[], Any], times: int) -> float:
    timed = Score()
    timed.run(lambda: (call(), None)[1], None, times)
    return 1e3 * float(np.median(timed.times))


def threads(camera: Camera, options: Any) -> Rows:
    """Frames a second by one thread and by two that share a detector, taken in turn."""
    detector = detector_of(scenes.ring_marker(), camera)
    images, rates = list[Image](), dict[int, list[float]]()
    for k in range(4):
        rng = np.random.default_rng([k, 9])
        placed = scenes.pose(camera, rng)
        images.append(scenes.view(scenes.ring_marker(), camera, placed, rng, Optics(), "photo").image)
    rounds = max(options.count, 3)
    os.sched_setaffinity(0, CORES)
    for _ in range(rounds):
        for count in (1, 2):
            with ThreadPoolExecutor(count) as pool:
                list(pool.map(detector, images))
                began = time.perf_counter()
                list(pool.map(detector, 4 * images))
                rates.setdefault(count, []).append(4 * len(images) / (time.perf_counter() - began))
    os.sched_setaffinity(0, {min(CORES)})
    best = {count: max(rate) for count, rate in rates.items()}
    return {f"{count} threads": {"frames/s": rate, "ratio": rate / best[1]} for count, rate in best.items()}


def memory(_: Any) -> dict[str, Rows]:
    """Peak memory of a process that detects in one large image, MB above what imports and the image take."""
    camera, rows = scenes.camera_of(*map(int, LARGE.split("x"))), Rows()
    rng = np.random.default_rng(10)
    photo = scenes.view(scenes.ring_marker(), camera, scenes.pose(camera, rng), rng, Optics(), "photo").image
    images = {"photograph": photo, "page of text": scenes.crowd("page of text", camera.width, camera.height, rng)}
    for name, image in images.items():
        with tempfile.TemporaryDirectory() as folder:
            np.save(f"{folder}/image.npy", image)
            code = f"from benchmarks.detection import peak; peak({folder!r}, {LARGE!r})"
            peak_mb = float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout)
        rows[name] = {"MB": peak_mb, "bytes/px above 50 MB": (peak_mb - 50) * 1e6 / image.size}
    return {f"peak memory, {LARGE}": rows}


def peak(folder: str, size: str) -> None:
    """Print what detection in an image adds to the memory of this process at its peak, MB."""
    detector = detector_of(scenes.ring_marker(), scenes.camera_of(*map(int, size.split("x"))))
    image = np.load(f"{folder}/image.npy")
    Path("/proc/self/clear_refs").write_text("5")
    before = _status_kb("VmRSS")
    detector(image)
    print((_status_kb("VmHWM") - before) * 1024 / 1e6)


def _status_kb(name: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith(name)).split()[1])


def score(scores: dict[str, Score], label: str) -> Score:
    return scores.setdefault(label, Score())


def ours(detector: Any, image: Image, **options: Any) -> Sight:
    hits = [item for item in detector(image, **options) if item.ok]
    return (hits[0].ids.tolist(), hits[0].pixels) if hits else None


def track(scores: dict[str, Score], label: str, detector: Any, scene: scenes.Scene, behind: Any, k: int) -> None:
    """Time the frame after a scene, in which the marker has moved by about a percent of the distance and a degree."""
    previous = detector(scene.image)
    rng = np.random.default_rng([k, 3])
    rotated = exponential(rng.normal(0, 0.01, 3)) @ scene.rotation
    moved = rotated, scene.translation + rng.normal(0, 0.01, 3) * scene.translation[2]
    after = scenes.view(scene.marker, scene.camera, moved, rng, Optics(), behind)
    score(scores, label).run(partial(ours, detector, after.image, near=previous), after.pixels)


FAST = "cv2.aruco, subpixel, fast"


def fast_aruco() -> Any:
    """Return ArUco's detector in its fast mode."""
    engine = rigs.engine()
    parameters = engine.getDetectorParameters()
    parameters.useAruco3Detection, parameters.minMarkerLengthRatioOriginalImg = True, SMALLEST_SHARE
    engine.setDetectorParameters(parameters)
    return engine


def aruco() -> dict[str, Callable[[Image], Sight]]:
    """Return ArUco's detector without refinement of corners, with that to subpixels, and fast."""
    plain = rigs.engine()
    parameters = plain.getDetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    plain.setDetectorParameters(parameters)

    def detector(engine: Any) -> Callable[[Image], Sight]:
        def detect(image: Image) -> Sight:
            corners, ids, _ = engine.detectMarkers(image)
            return _tag_sight([(int(i), c[0]) for i, c in zip(np.ravel(ids), corners, strict=True)] if corners else [])

        return detect

    return {
        "cv2.aruco, no refinement": detector(plain), "cv2.aruco, subpixel": detector(rigs.engine()),
        FAST: detector(fast_aruco()),
    }  # fmt: skip


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


@cache
def grid_marker() -> mg.Marker:
    columns, rows = GRID
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2, (rows - 1) / 2 - np.arange(rows))
    places = 0.045 * np.stack([x.ravel(), y.ravel()], axis=-1)
    return build_marker(places, Circle(scenes.RADIUS), diameter=0.025, clearance=0.0025, keyed=False)


def grid_scene(camera: Camera, placed: tuple[Array, Array], behind: Any, k: int) -> tuple[Image, Array]:
    scene = scenes.view(grid_marker(), camera, placed, np.random.default_rng([k, 5]), Optics(), behind)
    return scene.image, scene.pixels


def circles_grid(image: Image) -> Sight:
    ok, centers = cv2.findCirclesGrid(image, GRID, flags=cv2.CALIB_CB_SYMMETRIC_GRID)
    return (range(len(centers)), np.asarray(centers, dtype=float).reshape(-1, 2)) if ok else None


def half_turned(detect: Callable[[Image], Sight], image: Image, truth: Array) -> Sight:
    """Return a grid in the order of two that is nearer the truth, since it looks the same after half a turn."""
    sight = detect(image)
    if sight is None:
        return None
    ids, pixels = np.array(sight[0]), sight[1]
    return min(((order.tolist(), pixels) for order in (ids, len(truth) - 1 - ids)),
               key=lambda option: np.linalg.norm(option[1] - truth[option[0]], axis=-1).max())  # fmt: skip


def photographs(options: Any) -> dict[str, Rows]:
    """CPU time in labeled photographs: our markers, our dots, and ArUco, which has nothing to find there."""
    folder, rows = photos(options.photos), Rows()
    if folder is None:
        print("photographs skipped: no folder given, and none in MARKERGEN_PHOTOS\n")
        return {}
    for kind in (*GRIDS, "random_dots"):
        files = sorted((folder / kind).glob("marker*.json"))
        lens = folder / kind / "camera.yaml"
        detector, peer = mg.Detector(files, lens if lens.exists() else None), aruco()["cv2.aruco, subpixel"]
        calls: dict[str, Callable[[Image], Any]] = {"markers": detector, "dots": detector.dots, "aruco": peer}
        times: dict[str, list[float]] = {name: [] for name in calls}
        for path, _ in labeled(folder / kind):
            image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
            for name, call in calls.items():
                times[name].append(milliseconds(partial(call, image), 1))
        rows[kind] = {f"{name} ms": float(np.median(spent)) for name, spent in times.items()}
    return {"photographs": rows}


def starts(_: Any) -> dict[str, Rows]:
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
    return {"import and first call": {name: {"CPU s": min(time[name] for time in times[1:])} for name in codes}}


PARTS: dict[str, Callable[[Any], dict[str, Rows]]] = {
    "starts": starts, "photographs": photographs, "sizes": of_sizes(rendered), "bodies": of_sizes(bodies, "bodies, {}"),
    "worst": of_sizes(worst, "worst frames, {}"), "threads": of_sizes(threads, "threads, {}"), "memory": memory,
}  # fmt: skip
CORES = os.sched_getaffinity(0)


if __name__ == "__main__":
    main()
