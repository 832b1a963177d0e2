"""A cube and a wall against what others offer for them: found, wrong, errors of the pose, CPU time per frame.

    python -m benchmarks.rigs [--views 1000] [--rig cube.json] [--aprilcube PYTHON] [--json F]

An 80 mm cube with 6 dots on each face before clutter (camera of 640x480 px and f = 800 px, from 0.25 to 0.6 m, all
directions): all faces together, the face alone whose own pose claims the least error, and a cube of the same size with
an ArUco tag on each face, as aprilcube makes it: by cv2.aruco with the pose of all corners in view, and by aprilcube's
own code, which needs OpenCV below 5 and so the Python of an environment of its own. Poses, backgrounds and noise are
the same. A pose off by more than 10 degrees or 10 % is wrong.

A wall of six plates of 0.2 m before photographs: time beside ArUco's GridBoard of six tags in the same places.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks import detection_scenes as scenes
from benchmarks.detection_scenes import Image, Rows
from markergen.arrays import Array
from markergen.defaults import PRINT_SIGMA
from markergen.detect.detector import body_poses
from markergen.estimators.budget import ErrorSources
from markergen.maths.rotation import angle_between
from markergen.model.boundary import polygon_from
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.feature import Feature
from markergen.model.marker import ControlPoint, Marker
from markergen.model.poses import named_poses
from markergen.model.tag import Tag
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS
from markergen.validation.print_error import misprinted

EDGE, FAMILY, CELLS = 0.08, "aruco:DICT_4X4_50", 8
POSES = "sphere:distance=0.25..0.6m,sampling=random,count={}"
WRONG_DEG, WRONG_SHARE = 10.0, 0.1
FACES = {
    "+X": ((0, 1, 0), (0, 0, 1)), "-X": ((0, -1, 0), (0, 0, 1)), "+Y": ((-1, 0, 0), (0, 0, 1)),
    "-Y": ((1, 0, 0), (0, 0, 1)), "+Z": ((-1, 0, 0), (0, -1, 0)), "-Z": ((-1, 0, 0), (0, 1, 0)),
}  # fmt: skip
"""Directions to the right and up of aprilcube's faces, as seen from outside."""
PITCH, PLATE = 0.5, 0.2
WALL_VIEWS = {"640x480": 40, "1920x1080": 20}

APRILCUBE = """
import json, sys, time
import aprilcube, cv2, numpy as np
cv2.setNumThreads(1)
frames, found = np.load(sys.argv[2]), []
camera = dict(zip(("fx", "fy", "cx", "cy"), map(float, sys.argv[3:7])))
for frame in frames:
    detector = aprilcube.detector(sys.argv[1], camera, enable_filter=False)
    detector.process_frame(np.ascontiguousarray(frame), store_latest=False)
    began = time.process_time()
    result = detector.process_frame(np.ascontiguousarray(frame), store_latest=False)
    taken = time.process_time() - began
    pose = np.asarray(result["T"]).tolist() if result["success"] else None
    found.append({"pose": pose, "time": taken})
json.dump(found, open(sys.argv[7], "w"))
"""

Pose = tuple[Array, Array]


@dataclass
class Score:
    """Poses found in a series of frames: their errors, and which of them are wrong."""

    errors: dict[int, tuple[float, float]] = field(default_factory=dict)
    wrong: int = 0
    frames: int = 0
    times: list[float] = field(default_factory=list)

    def add(self, frame: int, results: Pose | None, truth: Pose, seconds: float = np.nan) -> None:
        self.frames += 1
        self.times.append(seconds)
        if results is None:
            return
        rotated = float(np.rad2deg(angle_between(results[0], truth[0])))
        moved = float(np.linalg.norm(results[1] - truth[1]))
        if rotated > WRONG_DEG or moved > WRONG_SHARE * np.linalg.norm(truth[1]):
            self.wrong += 1
        else:
            self.errors[frame] = rotated, 1e3 * moved

    def row(self, common: set[int]) -> dict[str, Any]:
        rotated, moved = np.array(list(self.errors.values()) or [(np.nan, np.nan)]).T
        both = np.array([self.errors[k][0] for k in sorted(common)] or [np.nan])
        return {
            "frames": self.frames, "right": len(self.errors), "wrong": self.wrong,
            "median deg": float(np.median(rotated)), "RMS deg": float(np.sqrt(np.mean(rotated**2))),
            "95 % deg": float(np.quantile(rotated, 0.95)), "median mm": float(np.median(moved)),
            "RMS mm": float(np.sqrt(np.mean(moved**2))),
            "RMS deg of common": float(np.sqrt(np.mean(both**2))), "CPU ms": 1e3 * float(np.median(self.times)),
        }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--views", type=int, default=1000, help="of the cubes")
    parser.add_argument("--rig", help="rig.json of a cube; designed if not given")
    parser.add_argument("--wall", help="rig.json of a wall; designed if not given")
    parser.add_argument("--aprilcube", help="Python of an environment with aprilcube")
    parser.add_argument("--json", help="where to write the results")
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    cv2.setNumThreads(1)

    def show(title: str, rows: Rows) -> None:
        scenes.print_table(title, rows)
        scenes.save_run(options.json, {title: rows})

    cube = mg.Rig.load(options.rig) if options.rig else mg.rig("cube", edge=EDGE, n=6).rig
    show("cube", cubes(cube, options.views, options.aprilcube))
    wall = mg.Rig.load(options.wall) if options.wall else mg.rig("wall 3x2", pitch=PITCH, plate=PLATE).rig
    for size, views in WALL_VIEWS.items():
        show(f"wall, {size}", walls(wall, scenes.camera_of(*map(int, size.split("x"))), views))


def cubes(rig: mg.Rig, views: int, aprilcube: str | None) -> Rows:
    """Both cubes in the same poses before the same clutter; this one also as printed to 0.1 mm."""
    camera, poses, tags = PAPER_CAMERA, named_poses(POSES.format(views)), tag_cube()
    exact, printed = mg.Detector(rig, camera, print_sigma="0mm"), mg.Detector(rig, camera)
    aruco, frames, scores = tag_poses(tags, camera), list[Image](), dict[str, Score]()
    for k, truth in enumerate(zip(poses.rotation, poses.translation, strict=True)):
        clutter = Scenery(BACKGROUNDS["clutter"](camera, np.random.default_rng([k, 0])))
        made = misprinted(rig, ErrorSources(PRINT_SIGMA), np.random.default_rng([k, 2]))
        image, rough, other = (
            render_view(item, camera, *truth, Optics(), np.random.default_rng([k, 1]), clutter)
            for item in (rig, made, tags)
        )
        for what, detector, seen in (("exact", exact, image), (f"{1e3 * PRINT_SIGMA:g} mm", printed, rough)):
            finding, seconds = timed(detector, seen)
            joint, alone = poses_of(rig, finding)
            scores.setdefault(f"this cube, print {what}", Score()).add(k, joint, truth, seconds)
            scores.setdefault(f"its best face alone, print {what}", Score()).add(k, alone, truth)
        pose, seconds = timed(aruco, other)
        scores.setdefault("cv2.aruco, all corners, exact", Score()).add(k, pose, truth, seconds)
        frames.append(other)
    if aprilcube:
        score = scores["aprilcube, exact"] = Score()
        for k, item in enumerate(by_aprilcube(aprilcube, np.stack(frames), camera)):
            matrix = np.array(item["pose"] or np.eye(4))
            pose = (matrix[:3, :3], matrix[:3, 3] / 1e3) if item["pose"] else None
            score.add(k, pose, (poses.rotation[k], poses.translation[k]), item["time"])
    return rows_of(scores)


def walls(rig: mg.Rig, camera: Camera, views: int) -> Rows:
    """A wall of dots beside a GridBoard of six tags in the same places."""
    places = enumerate(rig.markers)
    board = mg.Rig(tuple(replace(item, marker=tag_plate(PLATE, k)) for k, item in places))
    reach = rig.radius * camera.fx / (0.45 * camera.height)
    poses = named_poses(f"cone:distance={reach:.3g}..{1.5 * reach:.3g}m,tilt=0..50,count={views}")
    detector, aruco = mg.Detector(rig, camera, print_sigma="0mm"), grid_board(board, camera, engine())
    scores = {"this wall": Score(), "ArUco's GridBoard": Score()}
    for k, truth in enumerate(zip(poses.rotation, poses.translation, strict=True)):
        behind = Scenery(scenes.background("photo", camera, np.random.default_rng([k, 0])))
        image, other = (
            render_view(item, camera, *truth, Optics(), np.random.default_rng([k, 1]), behind) for item in (rig, board)
        )
        finding, seconds = timed(detector, image)
        scores["this wall"].add(k, poses_of(rig, finding)[0], truth, seconds)
        pose, seconds = timed(aruco, other)
        scores["ArUco's GridBoard"].add(k, pose, truth, seconds)
    return rows_of(scores)


def rows_of(scores: dict[str, Score]) -> Rows:
    """Rows of a table; errors also over the frames in which all are right."""
    common = set.intersection(*(set(score.errors) for score in scores.values()))
    return {name: score.row(common) for name, score in scores.items()}


def poses_of(rig: mg.Rig, findings: Any) -> tuple[Pose | None, Pose | None]:
    """Pose of the first rig found, and that of the face whose own pose claims the least error."""
    seen = next((item for item in findings if item.ok), None)
    if seen is None:
        return None, None
    parts = body_poses(seen.finding, rig, seen.camera, ErrorSources(PRINT_SIGMA))
    if not parts:
        return (seen.rotation, seen.translation), None
    number, pose = min(parts, key=lambda part: float(part[1].budget.rotation_deg["total"]))
    placed = rig.constellations[number].plate
    rotation = pose.rotation @ placed.rotation_matrix.T
    return (seen.rotation, seen.translation), (rotation, pose.translation - rotation @ placed.translation_vector)


def timed(work: Callable[[Image], Any], image: Image) -> tuple[Any, float]:
    """Run twice, the first time to warm up, and return the result and the processor time in s."""
    work(image)
    began = time.process_time()
    result = work(image)
    return result, time.process_time() - began


def tag_plate(edge: float, number: int) -> Marker:
    """Square plate with a tag alone: a point without size makes it a marker."""
    half = edge / 2
    square = polygon_from([np.array([[half, half], [-half, half], [-half, -half], [half, -half]])])
    tag = Tag(FAMILY, number, edge * (CELLS - 2) / CELLS)
    return Marker((ControlPoint(0, 0.0, 0.0, 0.0, Feature(0.0)),), square, 0.0, tag=tag)


def tag_cube() -> mg.Rig:
    """Cube with the tags 0 to 5, as aprilcube places them."""
    faces = []
    for k, (name, (right, up)) in enumerate(FACES.items()):
        rotation = np.stack([right, up, np.cross(right, up)], axis=1).astype(float)
        faces.append(mg.Plate(name, tag_plate(EDGE, k), rotation.tolist(), tuple(rotation[:, 2] * EDGE / 2)))
    return mg.Rig(tuple(faces))


def corners_of(tags: mg.Rig) -> Array:
    """Corners (k, 4, 3) of the tags in m, rig frame."""
    corners = []
    for marker in tags.markers:
        assert marker.marker.tag is not None
        corners.append(marker.to_body(np.column_stack([marker.marker.tag.corners, np.zeros(4)])))
    return np.stack(corners)


def engine() -> Any:
    """ArUco's detector with corners to subpixels."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), parameters)


def tag_poses(tags: mg.Rig, camera: Camera) -> Callable[[Image], Pose | None]:
    """ArUco's detection of the tags, and the pose of all their corners in view: SQPnP, then least squares."""
    corners, detector = corners_of(tags), engine()

    def detect(image: Image) -> Pose | None:
        pixels, ids, _ = detector.detectMarkers(image)
        seen = zip(np.ravel(ids), pixels, strict=True) if len(pixels) else ()
        kept = [(int(number), item[0]) for number, item in seen if number < len(corners)]
        if not kept:
            return None
        points = np.concatenate([corners[i] for i, _ in kept])
        return solved(points, np.concatenate([item for _, item in kept]), camera)

    return detect


def grid_board(tags: mg.Rig, camera: Camera, detector: Any) -> Callable[[Image], Pose | None]:
    """ArUco's detection of a GridBoard, by a `Board` of the same corners, and its pose."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.Board(list(corners_of(tags).astype(np.float32)), dictionary, np.arange(len(tags.markers)))

    def detect(image: Image) -> Pose | None:
        pixels, ids, _ = detector.detectMarkers(image)
        if not len(pixels):
            return None
        points, images = board.matchImagePoints(pixels, ids)
        if points is None or len(points) < 4:
            return None
        return solved(points.reshape(-1, 3).astype(float), images.reshape(-1, 2), camera)

    return detect


def solved(points: Array, pixels: Array, camera: Camera) -> Pose | None:
    """Pose from corners (n, 3) and pixels (n, 2): of the solutions of SQPnP the one that fits best, then refined."""
    pixels = np.ascontiguousarray(pixels, dtype=float)
    count, turns, shifts, _ = cv2.solvePnPGeneric(points, pixels, camera.matrix, None, flags=cv2.SOLVEPNP_SQPNP)
    if not count:
        return None
    fits = []
    for rotation, offset in zip(turns, shifts, strict=True):
        rotation, offset = cv2.solvePnPRefineLM(points, pixels, camera.matrix, None, rotation.copy(), offset.copy())
        away = cv2.projectPoints(points, rotation, offset, camera.matrix, None)[0][:, 0] - pixels
        fits.append((float(np.sum(away**2)), rotation, offset))
    _, rotation, offset = min(fits, key=lambda item: item[0])
    return cv2.Rodrigues(rotation)[0], offset[:, 0]


def by_aprilcube(python: str, frames: Image, camera: Camera) -> list[dict[str, Any]]:
    """Run aprilcube's generator and detector in its own environment."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        command = Path(python).with_name("aprilcube")
        cells = ["--cell-size", str(1e3 * EDGE / CELLS), "--border-cell", "1", "--ids", "0-5"]
        made = [str(command), "generate", "--grid", "1x1x1", "--dict", "4x4_50", *cells, "-o", str(here / "cube")]
        subprocess.run(made, check=True, capture_output=True)
        np.save(here / "frames.npy", frames)
        lens = [str(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)]
        script = [python, "-c", APRILCUBE, str(here / "cube" / "config.json"), str(here / "frames.npy"), *lens]
        subprocess.run([*script, str(here / "found.json")], check=True, capture_output=True)
        return json.loads((here / "found.json").read_text())


if __name__ == "__main__":
    main()
