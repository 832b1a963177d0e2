"""COLMAP's images.bin: of every image its number, quaternion (w first), translation, camera, name and points."""

# tests: tests/read/test_poses.py

import struct

import numpy as np

from markergen.arrays import Array

_POSE = struct.Struct("<I7dI")
_POINT = 24
"""Bytes of a point: x, y, and the number of the point in space."""


def is_images(data: bytes) -> bool:
    """True if all bytes are those of an images.bin."""
    return b"\0" in data[:8] and len(_places(data)) > 0


def image_poses(data: bytes) -> Array:
    """Return quaternions, w first, and translations (P, 7)."""
    return np.array([_POSE.unpack_from(data, place)[1:8] for place in _places(data)])


def _places(data: bytes) -> list[int]:
    """Places of the images; none if the data is something else."""
    count, place, places = int.from_bytes(data[:8], "little"), 8, []
    if len(data) < 8 or not 0 < count <= len(data) // (_POSE.size + 9):
        return []
    for _ in range(count):
        name_end = data.find(b"\0", place + _POSE.size)
        if name_end < 0 or name_end + 9 > len(data):
            return []
        places.append(place)
        place = name_end + 9 + _POINT * int.from_bytes(data[name_end + 1 : name_end + 9], "little")
    return places if place == len(data) else []
