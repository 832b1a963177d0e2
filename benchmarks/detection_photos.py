"""Detection on real photographs with labeled dots, one row for each.

    python -m benchmarks.detection_photos --photos FOLDER [--only dots markers grids] [--json F] [--against F]

dots:    labeled dots that are located
markers: markers of random dots, and photographs without any
grids:   grids, symmetric ones with any of their labelings; angles between poses against those of the robot's flange

The folder is also taken from the variable MARKERGEN_PHOTOS. It has a folder for each kind of marker, with the images,
labels.json, markers, and the camera where one is known.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks.detection_scenes import Image, Rows, chosen, load_run, parser_of, print_table, save_run
from markergen.arrays import Array
from markergen.maths.rotation import angle_between, exponential

HIT_PX, WRONG_PX, DOTS = 0.4, 3.0, 15
GRIDS = ("robot_grid", "circle_grid", "hex_grid", "dual_asymmetric")


def main() -> None:
    parser = parser_of(__doc__, PARTS)
    add_photos(parser)
    options = parser.parse_args()
    folder = photos(options.photos)
    if folder is None:
        sys.exit("photographs skipped: no folder given, and none in MARKERGEN_PHOTOS")
    before = load_run(options.against)
    for name in chosen(options, PARTS):
        rows = PARTS[name](folder)
        print_table(name, rows, before.get(name))
        save_run(options.json, {name: rows})


def add_photos(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photos", default=os.environ.get("MARKERGEN_PHOTOS"), help="folder of labeled photographs")


def photos(stated: str | None) -> Path | None:
    return Path(stated) if stated and Path(stated).is_dir() else None


def dots(folder: Path) -> Rows:
    """Labeled dots that `Detector.dots` has within 0.4 px, how far off these are, and how many dots it has in all."""
    rows: Rows = {}
    for kind in GRIDS:
        detector = _detector(folder / kind, [folder / kind / "marker.json"])
        gaps = list[Array]()
        for path, labels in labeled(folder / kind):
            places = [np.array(label[key]) for label in labels for key in label if key.startswith("centres")]
            centers = np.asarray(detector.dots(read(path)))
            gaps.append(nearest(np.concatenate(places), centers))
            rows[f"{kind} {path.name}"] = {**_row(gaps[-1]), "dots": len(centers)}
        rows[f"{kind}, all"] = _row(np.concatenate(gaps))
    return rows


def markers(folder: Path) -> Rows:
    """Markers in the photographs of random dots and the asymmetric grid; finds in photographs without any."""
    home = folder / "random_dots"
    files = sorted(home.glob("marker-*.json"), key=lambda path: int(path.stem.partition("-")[2]))
    numbers = [int(path.stem.partition("-")[2]) for path in files]
    detector = _detector(home, files)
    rows: Rows = {}
    for path, (labels,) in labeled(home):
        results = {k: [item for item in detector(read(path)) if numbers[item.index] == k] for k in numbers}
        for item in labels["markers"]:
            label = f"{path.name} marker {item['marker_id']}, {item['n_dots_matched']} dots"
            rows[label] = _marker_row(results.pop(item["marker_id"]), item)
        extra = [k for k, finding in results.items() if any(result.ok for result in finding)]
        rows[f"{path.name} absent markers"] = {"found": len(extra), "reason": f"found {extra}" if extra else ""}
    home = folder / "dual_asymmetric"
    for path, _ in labeled(home):
        (result, *_) = _detector(home, [home / "marker.json"])(read(path))
        rows[path.name] = {"found": int(result.ok), "dots": len(result.pixels), "reason": result.reason}
    names = sorted((folder / "street").glob("*.jpg"))
    seeker = mg.Detector([*files, home / "marker.json"])
    finds = sum(result.ok for path in names for result in seeker(read(path)))
    rows[f"street, {len(names)} photographs"] = {"found": finds}
    return rows


def grids(folder: Path) -> Rows:
    """Grids found, with the median distance of their dots from the nearest label; wrong dots are over 3 px from any.

    For robot_grid, whose flange's poses are known, also how the angle between a photograph's pose and that of the
    first differs from the flange's.
    """
    rows: Rows = {}
    for kind in (*GRIDS, "symmetric_grid", "asymmetric_grid"):
        lens = folder / kind / "camera.yaml"
        detector = mg.Detector(folder / kind / "marker.json", lens if lens.exists() else None, symmetric="any")
        entries = dict(labeled(folder / kind)) if (folder / kind / "labels.json").exists() else {}
        first = None
        for path in sorted(path for path in (folder / kind).iterdir() if path.suffix in (".png", ".jpg")):
            began = time.process_time()
            (result, *_) = detector(read(path))
            row = rows[f"{kind} {path.name}"] = {"found": int(result.ok), "dots": len(result.ids)}
            row["CPU ms"] = 1e3 * (time.process_time() - began)
            places = [
                np.array(label[key]) for label in entries.get(path, []) for key in label if key.startswith("centres")
            ]
            if result.ok and places:
                gap = nearest(result.pixels, np.concatenate(places))
                row |= {"wrong": int(np.sum(gap > WRONG_PX)), "median px": float(np.median(gap))}
            flange = path.with_suffix(".flange-pose.yaml")
            if result.ok and result.rotation is not None and flange.exists():
                pose = result.rotation, _flange(flange)
                first = first or pose
                camera, arm = (float(angle_between(b, a)) for a, b in zip(first, pose, strict=True))
                row["angle off, deg"] = abs(float(np.rad2deg(camera - arm)))
            row["reason"] = result.reason
    return rows


def _flange(path: Path) -> Array:
    """Rotation (3, 3) of the flange in the robot's base."""
    values = dict(line.split(": ") for line in path.read_text().splitlines() if ": " in line)
    x, y, z, w = (float(values[name]) for name in ("qx", "qy", "qz", "qw"))
    axis = np.array([x, y, z])
    angle = 2 * np.arctan2(np.linalg.norm(axis), w)
    return np.asarray(exponential(axis / np.linalg.norm(axis) * angle))


def labeled(folder: Path) -> Iterator[tuple[Path, list[Any]]]:
    """Images of a folder with the entries of its labels.json; one without an image's name belongs to the one before."""
    images: dict[str, list[Any]] = {}
    for item in json.loads((folder / "labels.json").read_text()):
        images.setdefault(item.get("image", next(reversed(images), "")), []).append(item)
    for name, entries in images.items():
        yield folder / name, entries


def read(path: Path) -> Image:
    return np.asarray(cv2.imread(str(path)))


def nearest(places: Array, centers: Array) -> Array:
    """Distances (m,) in px from places (m, 2) to the nearest of the centers (k, 2)."""
    if not len(centers):
        return np.full(len(places), np.inf)
    return np.asarray(np.linalg.norm(places[:, None] - centers, axis=-1).min(axis=1))


def _detector(folder: Path, files: list[Path]) -> mg.Detector:
    camera = folder / "camera.yaml"
    return mg.Detector(files, camera if camera.exists() else None)


def _row(gap: Array) -> dict[str, Any]:
    hit = gap[gap < HIT_PX]
    error = {"median px": float(np.median(hit)), "95 % px": float(np.quantile(hit, 0.95))} if len(hit) else {}
    return {"labeled": len(gap), "hit": len(hit), "hit %": 100 * len(hit) / len(gap), **error}


def _marker_row(findings: list[mg.Found], label: Any) -> dict[str, Any]:
    hits = [hit for hit in findings if hit.ok]
    places = dict(zip(label["dot_index"], np.array(label["dot_px"]), strict=True))
    gaps = [
        float(np.linalg.norm(pixel - places[int(k)]))
        for hit in hits for k, pixel in zip(hit.ids, hit.pixels, strict=True) if int(k) in places
    ]  # fmt: skip
    wrong = bool(hits) and (len(hits) > 1 or not gaps or max(gaps) > WRONG_PX)
    return {
        "found": int(bool(hits)), "wrong": int(wrong), "dots": len(hits[0].ids) if hits else 0,
        "median px": float(np.median(gaps)) if gaps else np.nan, "reason": "" if hits else findings[0].reason,
    }  # fmt: skip


PARTS = {"dots": dots, "markers": markers, "grids": grids}


if __name__ == "__main__":
    main()
