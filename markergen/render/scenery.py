"""Surroundings of a marker in a view: backgrounds behind it and occluders in front of it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.coverage import paint
from markergen.model.body import Body
from markergen.model.camera import Camera
from markergen.registry import Registry
from markergen.render.optics import Optics
from markergen.render.patches import Patch, project_patches

Grey = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Occluder:
    """Object in front of the marker.

    Attributes
    ----------
    outlines : tuple of arrays (m, 2), px
        Closed polygons in the image.
    grey : float or array (height, width)
        Uniform grey level, 0 to 255, or the texture's grey level at each pixel of the image.
    """

    outlines: tuple[Array, ...]
    grey: float | Grey


@dataclass(frozen=True, eq=False)
class Scenery:
    """Background behind the patches of a view, and occluders in front of them.

    Attributes
    ----------
    background : None, float or array (height, width)
        Grey levels behind the plate, 0 to 255: the substrate's for None, one for all, or one per pixel.
    occluders : tuple of Occluder
        Painted in this order, over everything else.

    Raises
    ------
    InputError
        If a background's grey levels are not finite.
    """

    background: float | NDArray[np.generic] | None = None
    occluders: tuple[Occluder, ...] = ()

    def __post_init__(self) -> None:
        if self.background is not None and not np.isfinite(self.background).all():
            raise InputError("a background of finite grey levels", "nan or infinity in it", "give levels from 0 to 255")

    def ink_behind(self, camera: Camera, optics: Optics, fineness: int) -> Grey | None:
        """Ink coverage (fineness h, fineness w) with the background's grey levels; None if it is all substrate.

        Raises
        ------
        InputError
            If the background's size is not the camera's.
        """
        if self.background is None:
            return None
        size = (camera.height, camera.width)
        if np.ndim(self.background) not in (0, 2) or (np.ndim(self.background) and np.shape(self.background) != size):
            raise InputError(
                f"a background of {camera.width}x{camera.height} pixels, one value each",
                f"an array of shape {np.shape(self.background)}",
                "crop or scale it to the camera's image",
            )
        return _finer(_ink(np.broadcast_to(np.asarray(self.background, np.float32), size), optics), fineness)

    def cover(self, ink: Grey, optics: Optics, fineness: int) -> None:
        """Paint the occluders over a scene (fineness h, fineness w) in place."""
        for occluder in self.occluders:
            levels = _ink(np.asarray(occluder.grey, dtype=np.float32), optics)
            paint(ink, occluder.outlines, _finer(levels, fineness) if levels.ndim else levels, fineness)


def _ink(grey: Grey, optics: Optics) -> Grey:
    """Ink coverage that yields these grey levels; may be below 0 or above 1."""
    return np.asarray((optics.light - grey) / np.float32(optics.light - optics.dark), dtype=np.float32)


def _finer(image: Grey, fineness: int) -> Grey:
    import cv2

    return cv2.resize(image, None, fx=fineness, fy=fineness, interpolation=cv2.INTER_NEAREST)


BACKGROUNDS: Registry[Callable[[Camera, np.random.Generator], Grey]] = Registry(
    "background", "markergen.render.scenery"
)
"""Backgrounds by name: functions of camera and random generator that draw grey levels (height, width), 0 to 255."""

_CLUTTER = 150
"""Number of shapes; they cover 25 to 33 % of an image."""
_PICTURES = (
    "astronaut",
    "brick",
    "camera",
    "chelsea",
    "coffee",
    "coins",
    "grass",
    "gravel",
    "moon",
    "page",
    "rocket",
    "text",
)
_SUBPIXEL_BITS = 4
"""Fractional bits of the coordinates that OpenCV draws at: sixteenths of a pixel."""


@BACKGROUNDS.register("clutter")
def clutter(camera: Camera, rng: np.random.Generator) -> Grey:
    """Rectangles, ellipses, rings, lines and text of all sizes and grey levels, many of which resemble dots."""
    import cv2

    size = np.array([camera.width, camera.height])
    x, y = np.linspace(0, 1, camera.width), np.linspace(0, 1, camera.height)[:, None]
    level, right, down = rng.uniform(0, 255), *rng.uniform(-200, 200, 2)
    image = (level + right * x + down * y).clip(0, 255).astype(np.uint8)
    scale = float(np.hypot(*size))
    for kind in rng.integers(0, 6, _CLUTTER):
        grey, angle = float(rng.integers(0, 256)), float(rng.uniform(0, 360))
        # Uniform on a logarithmic scale.
        width, height = scale * np.exp(rng.uniform(np.log(0.004), np.log(0.12), 2))
        middle = rng.uniform(0, 1, 2) * size
        thickness = int(rng.integers(1, 5))
        if kind == 0:
            corners = cv2.boxPoints((middle.tolist(), (width, height), angle))
            cv2.fillConvexPoly(image, _subpixels(corners), grey, cv2.LINE_AA, _SUBPIXEL_BITS)
        elif kind in (1, 2):
            # Twice as likely as any other kind: filled ellipses and rings.
            axes = _subpixels([width, max(height, width / 4)]) // 2
            cv2.ellipse(
                image, _subpixels(middle).tolist(), axes.tolist(), angle, 0, 360, grey,
                -1 if kind == 1 else thickness, cv2.LINE_AA, _SUBPIXEL_BITS,
            )  # fmt: skip
        elif kind == 3:
            letters = "".join(rng.choice(list("ABCDEGO068@&oe%.:8B")) for _ in range(int(rng.integers(2, 9))))
            font, place = cv2.FONT_HERSHEY_SIMPLEX, middle.astype(int).tolist()
            cv2.putText(image, letters, place, font, width / 60 + 0.3, grey, thickness, cv2.LINE_AA)
        elif kind == 4:
            points = middle + np.cumsum(rng.normal(0, width, (6, 2)), axis=0)
            cv2.polylines(image, [_subpixels(points)], False, grey, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
        else:
            corners = cv2.boxPoints((middle.tolist(), (2 * width, 2 * height), angle))
            cv2.polylines(image, [_subpixels(corners)], True, grey, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)
    return image.astype(np.float32)


@BACKGROUNDS.register("photo")
def photo(camera: Camera, rng: np.random.Generator) -> Grey:
    """Random crop of one of scikit-image's pictures, in grey, scaled to the image."""
    import cv2

    picture = _picture(str(rng.choice(_PICTURES)))
    size = np.array([camera.width, camera.height])
    whole = np.array(picture.shape[::-1])
    part = np.maximum((size * (whole / size).min() * rng.uniform(0.4, 1)).astype(int), 1)
    left, top = (rng.random(2) * (whole - part + 1)).astype(int)
    crop = picture[top : top + part[1], left : left + part[0]]
    shrinks = part[0] > size[0]
    return cv2.resize(crop, size.tolist(), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)


@lru_cache(maxsize=len(_PICTURES))
def _picture(name: str) -> Grey:
    from skimage import color, data

    picture = getattr(data, name)()
    grey = picture if picture.ndim == 2 else 255 * color.rgb2gray(picture)
    return np.asarray(grey, dtype=np.float32)


def hiding(
    body: Body, hidden: Iterable[int], camera: Camera, rotation: Array, translation: Array, rng: np.random.Generator
) -> tuple[Occluder, ...]:
    """Fingers on the plates that hide the given dots completely, and no others of their plates.

    A finger is a strip 10 % wider than the dot. It reaches the dot from outside the boundary, from the direction with
    the largest gap to the other dots; if every direction would touch another dot, a disk covers the dot alone.

    Parameters
    ----------
    hidden : iterable of int
        Numbers of the dots in the body.
    rotation, translation : arrays (3, 3) and (3,), m
        The pose T_camera_body.
    """
    occluders = []
    for dot in map(int, hidden):
        plate, k = body.plates[body.owner[dot]], dot - int(body.first[body.owner[dot]])
        marker, pose = plate.marker, plate.camera_pose(rotation, translation)
        point = marker.control_points[k]
        radius = 0.55 * point.feature.diameter
        gaps = marker.xyz[:, :2] - marker.xyz[k, :2]
        reach = marker.radii + radius
        directions = 2 * np.pi * (np.arange(16) + rng.random()) / 16
        along = np.stack([np.cos(directions), np.sin(directions)], axis=-1)
        ahead = np.maximum(gaps @ along.T, 0)
        free = np.linalg.norm(gaps[:, None] - ahead[..., None] * along, axis=-1) - reach[:, None]
        free[k] = np.inf
        best = int(np.argmax(free.min(axis=0)))
        length = 2.5 * marker.boundary.radius if free[:, best].min() > 0 else 0.0
        angle = directions[best] + np.linspace(np.pi / 2, 3 * np.pi / 2, 64)
        end = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * radius
        outline = marker.xyz[k, :2] + np.concatenate([end, length * along[best] - end])
        patch = Patch((np.column_stack([outline, np.full(len(outline), point.z)]),), 0.0)
        grey = float(rng.integers(40, 240))
        occluders += [Occluder(seen, grey) for seen in project_patches([patch], camera, *pose) if seen]
    return tuple(occluders)


def _subpixels(points: ArrayLike) -> NDArray[np.int32]:
    """Pixel coordinates in the fixed-point format of cv2's drawing functions."""
    return np.rint(np.asarray(points) * 2**_SUBPIXEL_BITS).astype(np.int32)
