"""Tags that are seen in an image, and what they say of labelings: the turn of a marker, and which of its family."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from markergen.detect.candidates import Model
from markergen.detect.fiducials import FiducialSettings, find_tags
from markergen.model.camera import Camera
from markergen.model.tag import Tag

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MATCH_PX, MATCH_SHARE = 2.0, 0.12
"""How far a tag's corner may lie from where a labeling puts it: px, plus a share of its longest side in the image. To
the next of the four turns it is a whole side, to the next label of a regular octagon half a one."""

PLACE_SHARE, SIZE_RATIO = 0.4, 2.0
"""A tag lies in the place of another if their middles are no farther apart than this share of a side, and neither is
larger by more than this ratio."""

SETTINGS = FiducialSettings("subpix", window=3)
"""Measured over the paper's poses: none reads more of the small and tilted tags, with the image enlarged neither."""

REFUTES, SILENT, CONFIRMS = -1, 0, 1


@dataclass(frozen=True, eq=False)
class Sightings:
    """Tags that were read in an image.

    Attributes
    ----------
    names : tuple of (family, id)
    pixels : array (k, 4, 2), px
        Of the corners, in the order of `Tag.corners`, in the image as taken.
    """

    names: tuple[tuple[str, int], ...] = ()
    pixels: Array = None  # type: ignore[assignment]  # set below: no array is a good default

    def __post_init__(self) -> None:
        if self.pixels is None:
            object.__setattr__(self, "pixels", np.zeros((0, 4, 2)))

    def __len__(self) -> int:
        return len(self.names)


NO_TAGS = Sightings()


def look_for_tags(image: NDArray[np.uint8] | NDArray[np.uint16], families: Collection[str]) -> Sightings:
    """Read all tags of these families in a grey image (h, w); images of 16 bits are stretched to their range."""
    if not families:
        return NO_TAGS
    if image.dtype == np.uint8:
        grey = np.asarray(image, dtype=np.uint8)
    else:
        level = image.astype(np.float32) - image.min()
        grey = (level * (255 / max(float(level.max()), 1.0))).astype(np.uint8)
    names, quads = [], []
    for family in sorted(families):
        for number, corners in find_tags(grey, family, SETTINGS):
            names.append((family, number))
            quads.append(corners)
    return Sightings(tuple(names), np.array(quads).reshape(-1, 4, 2))


def verdicts(model: Model, tag: Tag, camera: Camera, seen: Sightings) -> tuple[Indices, Indices]:
    """What the tags that are seen say of labelings, and which of them say so.

    A tag in the place where a labeling puts the marker's own confirms it if it is the same and its corners are where
    they should be; another one, or the same in another turn, refutes it.

    Returns
    -------
    state : array (A,) of int
        `CONFIRMS`, `REFUTES`, or `SILENT` where no tag is seen.
    which : array (A,) of int
        Index of the sighting, -1 for none.
    """
    corners = model.project(np.column_stack([tag.corners, np.zeros(4)]))
    count = len(corners)
    if not len(seen):
        return np.full(count, SILENT), np.full(count, -1)
    with np.errstate(invalid="ignore"):
        predicted = camera.to_pixels(corners)[:, None]
    offset = np.linalg.norm(predicted - seen.pixels, axis=-1).max(axis=-1)
    side, own_side = _longest_side(predicted), _longest_side(seen.pixels)
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = np.linalg.norm(predicted.mean(axis=-2) - seen.pixels.mean(axis=-2), axis=-1)
        ratio = np.abs(np.log(side / own_side))
        in_place = (apart < PLACE_SHARE * side) & (ratio < np.log(SIZE_RATIO))
    same = np.array([name == (tag.family, tag.id) for name in seen.names])
    allowed = MATCH_PX + MATCH_SHARE * own_side
    confirmed = in_place & same & (offset <= allowed)
    # What is nearly right is badly seen rather than another labeling.
    refuted = in_place & (~same | (offset > 2 * allowed))
    state = np.where(confirmed.any(axis=1), CONFIRMS, np.where(refuted.any(axis=1), REFUTES, SILENT))
    which = np.where(
        state == CONFIRMS, confirmed.argmax(axis=1), np.where(state == REFUTES, refuted.argmax(axis=1), -1)
    )
    return state, which


def _longest_side(quads: Array) -> Array:
    """Longest sides (...) in px of quadrangles (..., 4, 2)."""
    return np.asarray(np.linalg.norm(quads - np.roll(quads, -1, axis=-2), axis=-1).max(axis=-1))
