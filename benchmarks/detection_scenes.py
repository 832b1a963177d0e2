"""Scenes for the benchmarks of detection: markers, poses, backgrounds, damage, and what counts as right; all seeded."""

import argparse
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import markergen as mg
from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.coverage import paint
from markergen.maths.rotation import exponential, rotation_z
from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.feature import Feature, key_ring
from markergen.model.marker import ControlPoint, Marker
from markergen.model.tag import Tag
from markergen.render import Optics, Scenery, render_view
from markergen.render.scenery import BACKGROUNDS, Occluder, clutter, hiding

Image = NDArray[Any]
Rows = dict[str, dict[str, Any]]

RADIUS, RINGED, PLAIN = 0.15, 5, 8
CLEAN = Optics(noise_grey=1.0)
_WRONG_PX = 5.0
_TILE_PX = 1000


@dataclass(frozen=True, eq=False)
class Scene:
    """One image of a marker and the truth: its pose, the images (n, 2) of its dots in px, and the dots hidden."""

    image: Image
    marker: Marker
    camera: Camera
    rotation: Array
    translation: Array
    pixels: Array
    hidden: Sequence[int] = ()


@dataclass(frozen=True, eq=False)
class Verdict:
    """What a detector made of a scene; `error_px` (m,) belongs to a right labeling."""

    found: bool
    wrong: bool
    reason: str
    error_px: Array


def ring_marker() -> Marker:
    """Return the regular pentagon with key ring."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(RINGED) / RINGED
    return _marker(0.1284 * np.stack([np.cos(angles), np.sin(angles)], axis=-1), 0.036, ringed=True)


def random_marker(n: int, ringed: bool, seed: int, tag: int | None = None, diameter: float = 0.036) -> Marker:
    """Return random dots of this diameter if there is room, in the same disk, around a tag of 90 mm if one is given."""
    rng = np.random.default_rng([n, ringed, seed])
    diameter = round(min(diameter, 2 * RADIUS * np.sqrt((0.13 if tag is not None else 0.25) / n)), 4)
    inside = 0.0 if tag is None else 0.086 + diameter / 2
    points: list[Array] = []
    while len(points) < n:
        # Darts at random; when there is no room left, from the start.
        points = []
        for _ in range(5000):
            dart = rng.uniform(-RADIUS, RADIUS, 2)
            far = [np.linalg.norm(dart - other) > 1.2 * diameter for other in points]
            if inside <= np.linalg.norm(dart) <= RADIUS - 0.6 * diameter and all(far) and len(points) < n:
                points.append(dart)
    return _marker(np.array(points), diameter, ringed, None if tag is None else Tag("aruco:DICT_4X4_50", tag, 0.09))


def _marker(points: Array, diameter: float, ringed: bool, tag: Tag | None = None) -> Marker:
    features = [key_ring(diameter) if ringed and k == 0 else Feature(diameter) for k in range(len(points))]
    dots = (ControlPoint(k, float(x), float(y), 0.0, features[k]) for k, (x, y) in enumerate(points))
    return Marker(tuple(dots), Circle(RADIUS), 0.1 * diameter, tag=tag)


def camera_of(width: int, height: int) -> Camera:
    """Return a camera of this size that takes the views of the paper's camera, in finer pixels."""
    focal = PAPER_CAMERA.fx * height / PAPER_CAMERA.height
    return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def pose(
    camera: Camera,
    rng: np.random.Generator,
    distance: tuple[float, float] = (0.6, 1.2),
    tilt_deg: tuple[float, float] = (0, 55),
    radius: float = RADIUS,
) -> tuple[Array, Array]:
    """Return a random pose (3, 3), (3,) that sees a whole disk of the radius, anywhere in the image."""
    rim = Circle(radius).rim(64)
    rim = np.column_stack([rim, np.zeros(len(rim))])
    while True:
        tilt, (roll, angle) = np.deg2rad(rng.uniform(*tilt_deg)), rng.uniform(0, 2 * np.pi, 2)
        lean = exponential(np.array([np.pi - tilt, 0.0, 0.0]))
        rotation = np.asarray(rotation_z(np.array(roll)) @ lean @ rotation_z(np.array(angle)))
        ray = camera.from_pixels(rng.uniform(0, [camera.width, camera.height]))
        translation = np.append(ray, 1.0)
        # Tilts are relative to the line of sight only in the image center; elsewhere a few degrees more or less.
        translation *= rng.uniform(*distance) / np.linalg.norm(translation)
        if (
            rotation[:, 2] @ translation < 0
            and camera.sees(camera.project(rim, rotation[None], translation[None])).all()
        ):
            return rotation, translation


def background(name: str, camera: Camera, rng: np.random.Generator) -> Array | None:
    """Return a background (height, width) by name, in tiles, so that large images are as sharp as small ones."""
    if name == "plain":
        return None
    columns, rows = -(-camera.width // _TILE_PX), -(-camera.height // _TILE_PX)
    tile = camera_of(-(-camera.width // columns), -(-camera.height // rows))
    tiles = [[BACKGROUNDS[name](tile, rng) for _ in range(columns)] for _ in range(rows)]
    return np.asarray(np.block(tiles)[: camera.height, : camera.width], dtype=float)


def _text(image: Image, rng: np.random.Generator) -> None:
    """A printed page: lines of words in small letters, half of them bold."""
    height, width = image.shape
    y = 14
    while y < height:
        size, bold, x = float(rng.uniform(0.25, 0.6)), int(rng.integers(1, 3)), 8
        while x < width:
            word = "".join(rng.choice(list("aeionstrdlumcbpgfhqADEORSB0689.,;:"), int(rng.integers(2, 10))))
            cv2.putText(image, word, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, 30.0, bold, cv2.LINE_AA)
            x += 8 + cv2.getTextSize(word, cv2.FONT_HERSHEY_SIMPLEX, size, bold)[0][0]
        y += int(36 * size) + 2


def disks(image: Image, rng: np.random.Generator, count: int, semi: tuple[float, float], flat: float = 1.0) -> None:
    """Draw dark ellipses apart from each other, the shorter semi-axis at least `flat` times the longer one."""
    height, width = image.shape
    far = np.full((height // 2 + 1, width // 2 + 1), True)
    for _ in range(20 * count):
        radius = rng.uniform(*semi)
        x, y = rng.uniform(radius, [width - radius, height - radius])
        row, column, reach = int(y / 2), int(x / 2), int(radius + 1.5)
        around = far[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        if around.all() and count > 0:
            around[...], count = False, count - 1
            axes = (16 * radius, 16 * radius * rng.uniform(flat, 1))
            center, sizes = tuple(int(16 * v) for v in (x, y)), tuple(map(int, axes))
            cv2.ellipse(image, center, sizes, rng.uniform(0, 180), 0, 360, 40.0, -1, cv2.LINE_AA, 4)


def _grass(image: Image, rng: np.random.Generator) -> None:
    height, width = image.shape
    image[...] = 40
    for _ in range(image.size // 60):
        x, y = rng.uniform(0, [width, height])
        lean, length, curl = rng.uniform(0, 2 * np.pi), rng.uniform(4, 14), rng.normal(0, 0.6)
        path = np.cumsum([[x, y], *(length * np.array([np.sin(a), np.cos(a)]) for a in (lean, lean + curl))], axis=0)
        level, wide = float(rng.uniform(50, 200)), int(rng.integers(1, 3))
        cv2.polylines(image, [np.int32(16 * path)], False, level, wide, cv2.LINE_AA, 4)


def _keyboard(image: Image, rng: np.random.Generator) -> None:
    """Rows of dark keys with round corners, each with a light letter or a light dot."""
    height, width = image.shape
    for row, y in enumerate(range(12, height, 22)):
        for x in range(10 + 5 * (row % 4), width, 22):
            cv2.line(image, (x, y), (x + 3, y), 45.0, 16, cv2.LINE_AA)
            letter = str(rng.choice(list("QWERTZUIOPASDFGHJKLYXCVBNM0123456789....")))
            cv2.putText(image, letter, (x - 3, y + 4), cv2.FONT_HERSHEY_SIMPLEX, 0.3, 210.0, 1, cv2.LINE_AA)


CROWDS: dict[str, Callable[[Image, np.random.Generator], None]] = {
    "page of text": _text,
    "300 dots": lambda image, rng: disks(image, rng, 300, (0.0095 * image.shape[1],) * 2),
    "1,000 blobs": lambda image, rng: disks(image, rng, 1000, (2.5, 5.0), 0.5),
    "grass": _grass,
    "keyboard": _keyboard,
}
"""Frames full of what might be dots, drawn on light grey."""


def crowd(name: str, width: int, height: int, rng: np.random.Generator) -> Image:
    """Return an image of `CROWDS`."""
    image = np.full((height, width), 225, np.uint8)
    CROWDS[name](image, rng)
    return camera_like(image, rng)


def camera_like(image: Image, rng: np.random.Generator) -> Image:
    """Return an image with the blur and noise of a camera."""
    grey = cv2.GaussianBlur(np.asarray(image, dtype=float), (0, 0), 0.7)
    return np.clip(grey + rng.normal(0, 2, grey.shape), 0, 255).astype(np.uint8)


def view(
    marker: Marker,
    camera: Camera,
    placed: tuple[Array, Array],
    rng: np.random.Generator,
    optics: Optics = CLEAN,
    behind: str | Array | None = "plain",
    hidden: int = 0,
    covered: float = 0.0,
    damage: str = "",
    strangers: Marker | None = None,
) -> Scene:
    """Render a marker, with some dots hidden by fingers, a share of the image covered, and damage by name (`DAMAGE`).

    Strangers are the dots of another marker in the background, three copies of it.
    """
    rotation, translation = placed
    away = tuple(map(int, np.sort(rng.choice(len(marker), hidden, replace=False))))
    occluders: tuple[Occluder, ...] = hiding(marker, away, camera, rotation, translation, rng)
    occluders += scattered(covered, camera, rng) if covered else ()
    grey = background(behind, camera, rng) if isinstance(behind, str) else behind
    for _ in range(3 if strangers else 0):
        assert strangers is not None
        copy = render_view(strangers, camera, *pose(camera, rng), Optics(0.1, 0), rng, Scenery(grey))
        grey = copy.astype(float)
    scenery = Scenery(grey, occluders)
    if damage:
        image = DAMAGE[damage](marker, camera, placed, rng, scenery)
    else:
        image = render_view(marker, camera, rotation, translation, optics, rng, scenery)
    pixels = camera.project(marker.xyz, rotation[None], translation[None])[0]
    return Scene(image, marker, camera, rotation, translation, pixels, away)


LARGEST_SHARE = 0.9
"""Maximum share of the image that may be covered; random shapes take ever longer to reach more."""


def scattered(share: float, camera: Camera, rng: np.random.Generator) -> tuple[Occluder, ...]:
    """Random dark, bright and textured polygons that cover a share of the image, within 0.002.

    Raises
    ------
    InputError
        If the share is not 0 to 0.9.
    """
    if not 0 <= share <= LARGEST_SHARE:
        raise InputError(f"a share of 0 to {LARGEST_SHARE}", f"share={share}", "cover less of the image")
    size = np.array([camera.width, camera.height])
    covered = np.zeros((camera.height, camera.width), dtype=np.float32)
    texture = clutter(camera, rng)
    occluders = []
    while (missing := share - float(covered.mean())) > 0.002:
        area = min(rng.uniform(0.005, 0.04), missing) * size.prod()
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 10))))
        # Triangles to stars: vertices at random distances from the center.
        star = rng.uniform(0.4, 1, len(angle))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        x, y = star.T
        star *= np.sqrt(area / (abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2))
        outline = star + rng.uniform(0, 1, 2) * size
        grey = texture if rng.random() < 1 / 3 else float(rng.integers(0, 256))
        occluders.append(Occluder((outline,), grey))
        paint(covered, (outline,), np.float32(1), 1)
    return tuple(occluders)


def _lit(
    marker: Marker, camera: Camera, placed: tuple[Array, Array], rng: np.random.Generator, scenery: Scenery
) -> Array:
    """Return an image in grey levels before noise; damage to light comes before that of the sensor."""
    blur = Optics(noise_grey=0, bits=16)
    return render_view(marker, camera, *placed, blur, rng, scenery) / 257.0


def _sensed(grey: Array, rng: np.random.Generator) -> Image:
    return np.clip(np.rint(grey + rng.normal(0, 2, grey.shape)), 0, 255).astype(np.uint8)


def _shadow(marker: Marker, camera: Camera, placed: Any, rng: np.random.Generator, scenery: Scenery) -> Image:
    """Half of the marker lies in a shadow of 35 to 70 % with an edge 2 to 20 px wide, straight through the marker."""
    grey, (x, y), middle = _lit(marker, camera, placed, rng, scenery), _grid(camera), _middle(camera, placed, rng)
    rotation = rng.uniform(0, 2 * np.pi)
    across = (x - middle[0]) * np.cos(rotation) + (y - middle[1]) * np.sin(rotation)
    dark, soft = rng.uniform(0.35, 0.7), rng.uniform(0.5, 5)
    return _sensed(grey * (1 - dark * (1 + np.tanh(across / soft / 2)) / 2), rng)


def _highlight(marker: Marker, camera: Camera, placed: Any, rng: np.random.Generator, scenery: Scenery) -> Image:
    """Glossy print: a highlight of 60 to 200 grey levels with a sigma of 15 to 60 px on the marker; light saturates."""
    grey, (x, y), middle = _lit(marker, camera, placed, rng, scenery), _grid(camera), _middle(camera, placed, rng)
    square = ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / rng.uniform(15, 60) ** 2
    return _sensed(grey + rng.uniform(60, 200) * np.exp(-square / 2), rng)


def _motion(
    marker: Marker, camera: Camera, placed: tuple[Array, Array], rng: np.random.Generator, scenery: Scenery
) -> Image:
    optics = Optics(motion_px=float(rng.uniform(1, 5)), motion_deg=float(rng.uniform(0, 180)))
    return render_view(marker, camera, *placed, optics, rng, scenery)


def _jpeg(
    marker: Marker, camera: Camera, placed: tuple[Array, Array], rng: np.random.Generator, scenery: Scenery
) -> Image:
    image, quality = render_view(marker, camera, *placed, Optics(), rng, scenery), int(rng.integers(30, 91))
    return np.asarray(cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 0))


DAMAGE = {"shadow": _shadow, "highlight": _highlight, "motion": _motion, "jpeg": _jpeg}


def _grid(camera: Camera) -> Array:
    return np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height))).astype(float)


def _middle(camera: Camera, placed: tuple[Array, Array], rng: np.random.Generator) -> Array:
    """Return the image (2,) of a random place on the marker."""
    place = np.append(rng.uniform(-0.7, 0.7, 2) * RADIUS, 0.0)
    return camera.project(place[None], placed[0][None], placed[1][None])[0, 0]


def judge(results: Sequence[mg.Found], scene: Scene) -> Verdict:
    """Hold everything found in a scene with one marker against the truth.

    Wrong is a labeling with a dot over 5 px from its place, or nearer to another dot's place; also a second find.
    """
    hits = [result for result in results if result.ok]
    if not hits:
        return Verdict(False, False, results[0].reason, np.zeros(0))
    gaps = np.linalg.norm(hits[0].pixels[:, None] - scene.pixels, axis=-1)
    error = gaps[np.arange(len(gaps)), hits[0].ids]
    wrong = len(hits) > 1 or bool(np.any(error > _WRONG_PX) or np.any(gaps.argmin(axis=1) != hits[0].ids))
    return Verdict(True, wrong, "", error)


def parser_of(doc: str | None, parts: Iterable[str]) -> argparse.ArgumentParser:
    """Return a parser with the options that all benchmarks of detection share; `chosen` tells which parts to run."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *parts], help="all by default")
    parser.add_argument("--only", nargs="+", choices=list(parts), default=[], help="parts, likewise")
    parser.add_argument("--json", help="where to write the results")
    parser.add_argument("--against", help="results of an earlier run, to show both")
    return parser


def chosen(options: argparse.Namespace, parts: Iterable[str]) -> list[str]:
    return [*options.parts, *options.only] or list(parts)


def print_table(title: str, rows: Rows, before: Mapping[str, Mapping[str, Any]] | None = None) -> None:
    """Print a table; with an earlier run, numbers that have changed as ``before > now``."""
    columns = list(dict.fromkeys(name for row in rows.values() for name in row))
    lines = [[title, *columns]]
    for label, row in rows.items():
        now = [_cell(row.get(column)) for column in columns]
        old = [_cell((before or {}).get(label, {}).get(column)) for column in columns]
        changed = [
            a not in ("-", b) and not isinstance(row.get(c), str) for a, b, c in zip(old, now, columns, strict=True)
        ]
        lines.append([label, *(f"{a} > {b}" if new else b for a, b, new in zip(old, now, changed, strict=True))])
    widths = [max(len(line[k]) for line in lines) for k in range(len(columns) + 1)]
    for line in lines:
        cells = (cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True))
        print("  ".join([line[0].ljust(widths[0]), *cells]).rstrip())
    print(flush=True)


def _cell(value: Any) -> str:
    if value is None or value != value:
        return "-"
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"
    return str(value)


def load_run(path: str | None) -> dict[str, Rows]:
    """Read the results of an earlier run; nothing without a path."""
    return json.loads(Path(path).read_text()) if path else {}


def save_run(path: str | None, parts: Mapping[str, Rows]) -> None:
    """Write results, adding to those of other parts that the file has already."""
    if path:
        earlier = load_run(path) if Path(path).exists() else {}
        Path(path).write_text(json.dumps({**earlier, **parts}, indent=1) + "\n")
