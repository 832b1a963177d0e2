"""How accurate detection is, and how often it is wrong, on rendered views; every view has a seed of its own.

    python -m benchmarks.detection_quality [--only PART...] [--share 0.03] [--json F] [--against F] [--keep FOLDER]

centers:  errors of labeled dots and markers found, in clean, ordinary, steep, occluded and small views
labels:   wrong labelings in 5,000 views of many kinds and layouts, and why markers were refused
finds:    markers found in 1,000 images without one
disks:    markers of 5 to 60 dots found among 250 to 1,000 disks of equal size, in 300 images
coverage: true poses within the 95 % region of the covariance, clean and in damaged images, 2,000 each
small:    markers and dots found by the dots' diameter in the image
blurred:  markers found by blur and by the dots' diameter in the image, of dots apart and of close ones

A share of 0.03 takes two minutes, all of it an hour or two.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import re
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import markergen as mg
from benchmarks import detection_scenes as scenes
from benchmarks.detection_photos import nearest
from benchmarks.detection_scenes import Image, Rows, Scene, Verdict
from markergen.maths.rotation import logarithm
from markergen.model.camera import PAPER_CAMERA as CAMERA
from markergen.model.marker import Marker
from markergen.render import Optics
from markergen.render.scenery import BACKGROUNDS

CHI2_95_OF_6 = 12.5916
KINDS = ("ordinary", "steep", "occluded", "small", "noisy", "clutter", "strangers", "damaged")
EMPTY = ("photo", "clutter", "noise", "dots", "checkerboard", "text", "strangers", "gradient")
BLURS_PX, BLURRED_PX = (0.7, 1.0, 1.5, 2.0, 2.5, 3.0), (6, 8, 10, 12, 14, 16)
DISK_DOTS = (5, 6, 8, 12, 20, 30, 45, 60)
DIAMETERS_PX = (2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0)


def main() -> None:
    parser = scenes.parser_of(__doc__, PARTS)
    parser.add_argument("--share", type=float, default=1.0, help="of the views")
    parser.add_argument("--keep", type=Path, help="folder for the images of failures")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    before = scenes.load_run(options.against)
    for name in scenes.chosen(options, PARTS):
        for title, rows in PARTS[name](options.share, options.keep).items():
            scenes.print_table(title, rows, before.get(title))
            scenes.save_run(options.json, {title: rows})


@cache
def layouts() -> tuple[Marker, ...]:
    """Return markers with and without ring, of 4 to 30 dots, and four with a tag."""
    sizes = (4, 5, 6, 8, 12, 20, 30)
    bare = [scenes.random_marker(n, ringed, seed=2) for ringed in (True, False) for n in sizes]
    return (*bare, *(scenes.random_marker(n, ringed, 2, tag=n) for ringed in (True, False) for n in (6, 12)))


@cache
def detector_of(marker: Marker, exact: bool = False) -> mg.Detector:
    return mg.Detector(marker, CAMERA, print_sigma=0.0 if exact else "0.1mm")


def centers(share: float, keep: Path | None) -> dict[str, Rows]:
    steep, far = {"tilt_deg": (60.0, 75.0), "distance": (0.6, 0.9)}, {"distance": (2.2, 3.5)}
    ordinary: dict[str, Any] = {"optics": Optics(), "behind": "photo"}
    kinds: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "clean": ({}, {}), "ordinary": ({}, ordinary), "steep": (steep, ordinary), "occluded": ({}, ordinary),
        "small": (far, ordinary),
    }  # fmt: skip
    markers = [scenes.ring_marker(), *(scenes.random_marker(n, n == 12, seed=1) for n in (8, 12, 30))]
    rows: Rows = {}
    for index, (kind, (where, how)) in enumerate(kinds.items()):
        verdicts = []
        for k in range(max(round(160 * share), 1)):
            marker, rng = markers[k % 4], np.random.default_rng([1, index, k])
            hidden = len(marker) // 4 if kind == "occluded" else 0
            placed = scenes.pose(CAMERA, rng, **where)
            verdicts.append(see(scenes.view(marker, CAMERA, placed, rng, **how, hidden=hidden), keep, f"{kind}-{k}")[0])
        rows[kind] = summary(verdicts)
    return {"centers": rows}


def mixed(k: int) -> tuple[str, Scene]:
    """Return view k of the mixture for labels, and its kind."""
    rng = np.random.default_rng([2, k])
    kind, marker = KINDS[k % len(KINDS)], layouts()[int(rng.integers(len(layouts())))]
    where: dict[str, Any] = {}
    how: dict[str, Any] = {"optics": Optics(), "behind": str(rng.choice(["photo", "clutter", "plain"]))}
    if kind == "steep":
        where = {"tilt_deg": (60.0, 78.0), "distance": (0.6, 1.0)}
    elif kind == "small":
        where = {"distance": (1.5, 4.0)}
    elif kind == "occluded":
        how |= {"hidden": int(rng.integers(1, len(marker) // 2 + 1)), "covered": float(rng.choice([0.0, 0.1, 0.2]))}
    elif kind == "noisy":
        how["optics"] = Optics(
            blur_px=float(rng.uniform(0.5, 2)), noise_grey=float(rng.uniform(5, 20)), dark=60, light=180
        )
    elif kind == "clutter":
        how |= {"behind": "clutter", "covered": 0.1}
    elif kind == "strangers":
        how["strangers"] = layouts()[int(rng.integers(len(layouts())))]
    elif kind == "damaged":
        how["damage"] = str(rng.choice(list(scenes.DAMAGE)))
    if how.get("strangers") is marker:
        how["strangers"] = None
    return kind, scenes.view(marker, CAMERA, scenes.pose(CAMERA, rng, **where), rng, **how)


def labels(share: float, keep: Path | None) -> dict[str, Rows]:
    verdicts = dict[str, list[Verdict]]()
    for k in range(round(5000 * share)):
        kind, scene = mixed(k)
        verdicts.setdefault(kind, []).append(see(scene, keep, f"labels-{k}")[0])
    every = [item for group in verdicts.values() for item in group]
    reasons = Counter(re.sub(r"\d+", "#", item.reason) for item in every if not item.found)
    rows = {kind: summary(group) for kind, group in [*verdicts.items(), ("all", every)]}
    return {"labels": rows, "refused": {reason: {"views": count} for reason, count in reasons.most_common()}}


def empty(k: int) -> tuple[str, Image]:
    """Return image k without the markers that are looked for, and its kind."""
    rng, kind = np.random.default_rng([3, k]), EMPTY[k % len(EMPTY)]
    shape, grey = (CAMERA.height, CAMERA.width), rng.uniform(0, 255, 2)
    image: Image
    if kind in ("photo", "clutter"):
        image = BACKGROUNDS[kind](CAMERA, rng)
    elif kind == "noise":
        image = cv2.resize(rng.normal(128, 60, (shape[0] // (k % 5 + 1), shape[1] // (k % 5 + 1))), shape[::-1])
    elif kind == "checkerboard":
        y, x = np.indices(shape)
        side, rotation = rng.uniform(4, 60), rng.uniform(0, np.pi)
        u, v = np.cos(rotation) * x + np.sin(rotation) * y, np.cos(rotation) * y - np.sin(rotation) * x
        image = np.asarray(np.where((u // side + v // side) % 2 == 0, grey[0], grey[1]))
    elif kind == "gradient":
        image = np.add.outer(np.linspace(0, grey[0], shape[0]), np.linspace(0, 255 - grey[0], shape[1]))
    elif kind == "strangers":
        # The layouts that are looked for have other seeds.
        stranger = scenes.random_marker(int(rng.integers(4, 31)), bool(k // 8 % 2), seed=5)
        return kind, scenes.view(
            stranger, CAMERA, scenes.pose(CAMERA, rng), rng, Optics(), "photo", strangers=stranger
        ).image
    else:
        image = np.full(shape, 230, np.uint8)
        for _ in range(int(rng.integers(10, 300))):
            place, size = (rng.uniform(0, 1, 2) * shape[::-1]).astype(int).tolist(), rng.uniform(3, 20)
            if kind == "text":
                letters = "".join(rng.choice(list("o0.:;B8%ae"), 6))
                cv2.putText(image, letters, place, 0, size / 20, 20.0, 1, cv2.LINE_AA)
            else:
                ellipse = place, (size, size * rng.uniform(0.5, 1)), rng.uniform(0, 180)
                cv2.ellipse(image, ellipse, 30.0, -1, cv2.LINE_AA)
                cv2.circle(image, place, int(size / 4), 230.0 if rng.random() < 0.1 else 30.0, -1, cv2.LINE_AA)
    return kind, scenes.camera_like(image, rng)


def finds(share: float, keep: Path | None) -> dict[str, Rows]:
    ring5, ring12, plain8, plain30, tagged = (layouts()[k] for k in (1, 4, 10, 13, 16))
    sought = [ring5, ring12, plain8, plain30, tagged]
    detector, rows = mg.Detector(sought, CAMERA), Rows()
    for k in range(round(1000 * share)):
        kind, image = empty(k)
        hits = [result for result in detector(image) if result.ok]
        row = rows.setdefault(kind, {"images": 0, "finds": 0})
        row["images"], row["finds"] = row["images"] + 1, row["finds"] + len(hits)
        if hits:
            _keep(keep, f"find-{kind}-{k}", image, hits[0])
    rows["all"] = {name: sum(row[name] for row in rows.values()) for name in ("images", "finds")}
    return {"finds": rows}


def disks(share: float, keep: Path | None) -> dict[str, Rows]:
    """Markers of small dots, so that many places for them reach beyond the image."""
    rows: Rows = {}
    for n in DISK_DOTS:
        sought = scenes.random_marker(n, ringed=False, seed=7, diameter=0.012)
        for k in range(max(round(300 / len(DISK_DOTS) * share), 1)):
            rng, image = np.random.default_rng([7, n, k]), np.full((CAMERA.height, CAMERA.width), 225, np.uint8)
            scenes.disks(image, rng, int(rng.integers(250, 1001)), (float(rng.uniform(3.5, 7)),) * 2)
            image = scenes.camera_like(image, rng)
            hits = [result for result in detector_of(sought)(image) if result.ok]
            row = rows.setdefault(f"{n} dots", {"images": 0, "finds": 0})
            row["images"], row["finds"] = row["images"] + 1, row["finds"] + len(hits)
            if hits:
                _keep(keep, f"find-disks-{n}-{k}", image, hits[0])
    rows["all"] = {name: sum(row[name] for row in rows.values()) for name in ("images", "finds")}
    return {"finds among equal disks": rows}


def coverage(share: float, keep: Path | None) -> dict[str, Rows]:
    markers, rows = [scenes.ring_marker(), scenes.random_marker(12, True, seed=1)], Rows()
    for index, damage in enumerate(("", *scenes.DAMAGE)):
        inside, verdicts = [], []
        for k in range(max(round(2000 * share), 1)):
            rng = np.random.default_rng([4, index, k])
            placed = scenes.pose(CAMERA, rng, distance=(0.6, 1.0), tilt_deg=(15, 55))
            scene = scenes.view(markers[k % 2], CAMERA, placed, rng, Optics(), "photo", damage=damage)
            verdict, results = see(scene, keep, f"coverage-{damage}-{k}", exact=True)
            verdicts.append(verdict)
            if verdict.found and not verdict.wrong:
                inside.append(_mahalanobis(results[0], scene) <= CHI2_95_OF_6)
        rows[damage or "clean"] = summary(verdicts) | {"covered %": 100 * float(np.mean(inside)) if inside else np.nan}
    return {"coverage": rows}


def _mahalanobis(result: mg.Found, scene: Scene) -> float:
    """Return the squared distance of the true pose in terms of the covariance, chi-square of 6 if that is right."""
    assert result.rotation is not None
    assert result.translation is not None
    assert result.covariance is not None
    error = np.append(logarithm(scene.rotation @ result.rotation.T), scene.translation - result.translation)
    return float(error @ np.linalg.solve(result.covariance, error))


def small(share: float, keep: Path | None) -> dict[str, Rows]:
    rows: Rows = {}
    for ringed in (True, False):
        marker = scenes.random_marker(16, ringed, seed=3, diameter=0.014)
        for size in DIAMETERS_PX:
            distance, verdicts, nearby = CAMERA.fx * marker.dot_diameter / size, [], []
            for k in range(max(round(50 * share), 1)):
                rng = np.random.default_rng([5, ringed, int(10 * size), k])
                placed = scenes.pose(CAMERA, rng, (distance, distance), (0, 30))
                scene = scenes.view(marker, CAMERA, placed, rng)
                verdicts.append(see(scene, keep, f"small-{size}-{ringed}-{k}")[0])
                nearby.append(nearest(scene.pixels, np.asarray(detector_of(marker).dots(scene.image))) < 0.5)
            located = {"dots located %": 100 * float(np.mean(nearby))}
            rows[f"{size} px, {'ring' if ringed else 'no ring'}"] = summary(verdicts) | located
    return {"small dots": rows}


def blurred(share: float, keep: Path | None) -> dict[str, Rows]:
    tables = dict[str, Rows]()
    layouts = {"2 diameters apart": [0, 2, 4, 5, 6, 8, 9], "1.25 to 1.53 diameters apart": [1, 3, 7]}
    for apart, seeds in layouts.items():
        markers = [scenes.random_marker(5, True, seed=seed, diameter=0.016) for seed in seeds]
        rows = tables[f"found % by blur and diameter, {apart}"] = Rows()
        for blur in BLURS_PX:
            for size in BLURRED_PX:
                distance, verdicts = CAMERA.fx * markers[0].dot_diameter / size, []
                for k in range(max(round(50 * share), 1)):
                    rng = np.random.default_rng([6, int(10 * blur), size, k])
                    placed = scenes.pose(CAMERA, rng, (distance, distance), (0, 30))
                    scene = scenes.view(markers[k % len(markers)], CAMERA, placed, rng, Optics(blur_px=blur))
                    verdicts.append(see(scene, keep, f"blurred-{blur}-{size}-{k}-{len(markers)}")[0])
                rows.setdefault(f"blur {blur} px", {})[f"{size} px"] = summary(verdicts)["found %"]
    return tables


PARTS: dict[str, Callable[[float, Path | None], dict[str, Rows]]] = {
    "centers": centers, "labels": labels, "finds": finds, "disks": disks, "coverage": coverage,
    "small": small, "blurred": blurred,
}  # fmt: skip


def see(scene: Scene, keep: Path | None, name: str, exact: bool = False) -> tuple[Verdict, list[mg.Found]]:
    """Detect in a scene, and keep its image if that went wrong."""
    results = detector_of(scene.marker, exact)(scene.image)
    verdict = scenes.judge(results, scene)
    if verdict.wrong or not verdict.found:
        _keep(keep, f"{'wrong' if verdict.wrong else 'missed'}-{name}", scene.image, results[0])
    return verdict, results


def _keep(folder: Path | None, name: str, image: Image, result: mg.Found) -> None:
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"{name}.png"), image)
        cv2.imwrite(str(folder / f"{name}-seen.png"), result.draw(image))
        with (folder / "failures.txt").open("a") as log:
            log.write(f"{name}: {result.reason or 'found'}\n")


def summary(verdicts: list[Verdict]) -> dict[str, Any]:
    right = [verdict for verdict in verdicts if verdict.found and not verdict.wrong]
    error = np.concatenate([*(verdict.error_px for verdict in right), np.zeros(0)])
    return {
        "views": len(verdicts), "found %": 100 * sum(verdict.found for verdict in verdicts) / len(verdicts),
        "wrong": sum(verdict.wrong for verdict in verdicts),
        "median px": float(np.median(error)) if len(error) else np.nan,
        "95 % px": float(np.quantile(error, 0.95)) if len(error) else np.nan,
    }  # fmt: skip


if __name__ == "__main__":
    main()
