"""Detection on real photographs with labeled dots, one row for each.

    python -m benchmarks.detection_photos --photos FOLDER [--json F] [--against F]

The folder is also taken from the variable MARKERGEN_PHOTOS. It has a folder for each kind of marker, with the images,
labels.json, markers, and the camera where one is known.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks.detection_scenes import Image, Rows, load_run, print_table, save_run
from markergen.arrays import Array

HIT_PX, WRONG_PX, DOTS = 0.4, 3.0, 15
GRIDS = ("robot_grid", "circle_grid", "hex_grid", "dual_asymmetric")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_photos(parser)
    parser.add_argument("--json", help="where to write the results")
    parser.add_argument("--against", help="results of an earlier run, to show both")
    options = parser.parse_args()
    folder = photos(options.photos)
    if folder is None:
        sys.exit("photographs skipped: no folder given, and none in MARKERGEN_PHOTOS")
    parts, before = {"dots": dots(folder), "markers": markers(folder)}, load_run(options.against)
    for name, rows in parts.items():
        print_table(name, rows, before.get(name))
    save_run(options.json, parts)


def add_photos(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--photos", default=os.environ.get("MARKERGEN_PHOTOS"), help="folder of labeled photographs")


def photos(given: str | None) -> Path | None:
    return Path(given) if given and Path(given).is_dir() else None


def dots(folder: Path) -> Rows:
    """Labeled dots that `Detector.dots` has within 0.4 px, how far off these are, and how many dots it has in all."""
    rows: Rows = {}
    for kind in GRIDS:
        detector = _detector(folder / kind, [folder / kind / "marker.json"])
        gaps = list[Array]()
        for path, labels in labeled(folder / kind):
            places = [np.array(each[key]) for each in labels for key in each if key.startswith("centres")]
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
        results = {k: [each for each in detector(read(path)) if numbers[each.index] == k] for k in numbers}
        for each in labels["markers"]:
            label = f"{path.name} marker {each['marker_id']}, {each['n_dots_matched']} dots"
            rows[label] = _marker_row(results.pop(each["marker_id"]), each)
        extra = [k for k, found in results.items() if any(result.ok for result in found)]
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


def labeled(folder: Path) -> Iterator[tuple[Path, list[Any]]]:
    """Images of a folder with the entries of its labels.json; one without an image's name belongs to the one before."""
    images: dict[str, list[Any]] = {}
    for each in json.loads((folder / "labels.json").read_text()):
        images.setdefault(each.get("image", next(reversed(images), "")), []).append(each)
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


def _marker_row(found: list[mg.Found], label: Any) -> dict[str, Any]:
    hits = [each for each in found if each.ok]
    places = dict(zip(label["dot_index"], np.array(label["dot_px"]), strict=True))
    gaps = [
        float(np.linalg.norm(pixel - places[int(k)]))
        for each in hits for k, pixel in zip(each.ids, each.pixels, strict=True) if int(k) in places
    ]  # fmt: skip
    wrong = bool(hits) and (len(hits) > 1 or not gaps or max(gaps) > WRONG_PX)
    return {
        "found": int(bool(hits)), "wrong": int(wrong), "dots": len(hits[0].ids) if hits else 0,
        "median px": float(np.median(gaps)) if gaps else np.nan, "reason": "" if hits else found[0].reason,
    }  # fmt: skip


if __name__ == "__main__":
    main()
