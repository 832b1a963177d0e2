"""Recorded poses, and whether they seem to follow another convention than the one they are read by.

They are stored with the design, so that it can be repeated without their file.
"""
# tests: tests/model/test_poses.py tests/read/test_poses.py tests/read/test_pose_conventions.py

import hashlib
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.model.boundary import Boundary
from markergen.model.camera import Camera
from markergen.model.poses import SEEN, PoseDistribution, visibility

COLUMNS = "tx ty tz qx qy qz qw"
MOST_KEPT = 2000
"""Maximum number of poses stored in marker.json; of more poses that see the marker, a sample is taken."""

_LOOKED_AT = 5000
"""Number of poses that are tested with other conventions."""

_FLIP = np.diag([1.0, -1.0, -1.0])
WIDEST = np.deg2rad(120)
"""Field of view in rad that a camera is taken to have where none is known."""
USUAL, SURE = 0.8, 0.95
"""Shares of poses that look at the marker: fewer are doubted if more do by another convention. Inverses of poses on a
cone, and those with a quaternion in another order, look at it in 35 to 65 % of cases, as tried with 8 cones."""
FARTHEST = 50.0
"""Largest plausible distance in m of half of the poses: of a marker of 2 m, 10 px with a focal length of 250 px."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class RecordedPoses(PoseDistribution):
    """Poses of a file; files with the same content give equal poses, whatever their names.

    Attributes
    ----------
    numbers : array (P, 7)
        tx, ty, tz in m and the quaternion qx, qy, qz, qw of every pose T_camera_marker; rotation and translation are
        computed from them, to the last bit.
    file : str
        Name of the file, without its folder.
    sha256 : str
        SHA-256 of the file, hexadecimal.
    sampled_from : int
        Number of poses that see the whole marker, if these are a sample of them; 0 if they are all.
    """

    numbers: Array
    file: str
    sha256: str
    sampled_from: int = 0

    @staticmethod
    def of(numbers: Array, file: str, sha256: str, dropped: int = 0, sampled_from: int = 0) -> "RecordedPoses":
        """Make poses from finite numbers (P, 7); quaternions are normalized."""
        from scipy.spatial.transform import Rotation

        return RecordedPoses(
            _name(file, sampled_from),
            Rotation.from_quat(numbers[:, 3:]).as_matrix(),
            numbers[:, :3].copy(),
            dropped=dropped,
            numbers=numbers,
            file=file,
            sha256=sha256,
            sampled_from=sampled_from,
        )

    @staticmethod
    def from_numbers(numbers: Array, name: str = "poses", dropped: int = 0) -> "RecordedPoses":
        """Record poses, as numbers (P, 7), that do not come from a file, under a name."""
        return RecordedPoses.of(numbers, name, hashlib.sha256(numbers.tobytes()).hexdigest(), dropped)

    @staticmethod
    def from_distribution(poses: PoseDistribution, name: str = "poses") -> "RecordedPoses":
        """Record poses that do not come from a file, under a name."""
        from scipy.spatial.transform import Rotation

        numbers = np.hstack([poses.translation, Rotation.from_matrix(poses.rotation).as_quat()])
        return RecordedPoses.from_numbers(numbers, name, poses.dropped)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RecordedPoses) and self.sha256 == other.sha256

    def __hash__(self) -> int:
        return hash(self.sha256)

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, one line of numbers for each pose."""
        return {
            "file": self.file,
            "sha256": self.sha256,
            "dropped": self.dropped,
            "sampled_from": self.sampled_from,
            "columns": COLUMNS,
            # repr gives the shortest text that reads back as the same number.
            "rows": [" ".join(map(repr, row)) for row in self.numbers.tolist()],
        }

    def seen_whole(self, boundary: Boundary, camera: Camera, height: float = 0.0) -> Self:
        """See `PoseDistribution.seen_whole`; of more than 2000 remaining poses, a fixed random sample of 2000."""
        seen = super().seen_whole(boundary, camera, height)
        if len(seen) <= MOST_KEPT:
            return seen
        chosen = np.sort(np.random.default_rng(0).choice(len(seen), MOST_KEPT, replace=False))
        sample = seen.taken(chosen, seen.dropped)
        return replace(sample, name=_name(self.file, len(seen)), sampled_from=len(seen))

    def taken(self, indices: NDArray[np.intp], dropped: int) -> Self:
        """See `PoseDistribution.taken`."""
        return replace(super().taken(indices, dropped), numbers=self.numbers[indices])

    def plausibility(self) -> str:
        """Return what is odd about the poses whatever camera and marker they are for; or an empty string."""
        sample = slice(None, None, ceil(len(self) / _LOOKED_AT))
        return plausibility(self.rotation[sample], self.translation[sample])

    def _doubts(self, points: Array, camera: Camera, share: float) -> str:
        sample = slice(None, None, ceil(len(self) / _LOOKED_AT))
        # Fewer could be chance.
        best, most = "", max(2 * share, 0.1)
        for convention, rotation, translation in other_conventions(self.rotation[sample], self.translation[sample]):
            visible = float(np.mean(visibility(points, rotation, translation, camera) == SEEN))
            if visible > most:
                best, most = convention, visible
        return f"{100 * most:.0f} % would see it if the file {best}: look up which way its format goes" if best else ""


def _name(file: str, sampled_from: int) -> str:
    return f"{file}, a sample of {sampled_from}" if sampled_from else file


def plausibility(rotation: Array, translation: Array) -> str:
    """Return what is odd about poses whatever camera and marker they are for; or an empty string."""
    share = _looking(rotation, translation)
    if share < USUAL:
        # Directions do not depend on the unit.
        trials = [trial for trial in other_conventions(rotation, translation) if " mm" not in trial[0]]
        shares = [_looking(*poses) for _, *poses in trials]
        best = int(np.argmax(shares))
        least = f"{100 * share:.0f} % of the poses look at the marker's front"
        if shares[best] > max(2 * share, 0.1) or shares[best] > SURE:
            remedy = f"{100 * shares[best]:.0f} % would if the file {trials[best][0]}"
            return f"{least}; {remedy}: look up which way its format goes"
        if share < 1 / 2:
            return f"{least}, and not more by any usual convention: are they about another origin, or of a body?"
    away = float(np.median(np.linalg.norm(translation, axis=-1)))
    if away > FARTHEST:
        return f"half of the poses are more than {away:.4g} m away: is the unit another, such as mm?"
    return ""


def _looking(rotation: Array, translation: Array) -> float:
    """Share of poses whose camera is in front of the marker and has its origin in a view of `WIDEST`."""
    distance = np.maximum(np.linalg.norm(translation, axis=-1), np.finfo(float).tiny)
    front = np.sum(rotation[:, :, 2] * translation, axis=-1) < 0
    return float(np.mean(front & (translation[:, 2] > np.cos(WIDEST / 2) * distance)))


def other_conventions(rotation: Array, translation: Array) -> list[tuple[str, Array, Array]]:
    """Return common mistakes, in words, with the poses that would be meant."""
    from scipy.spatial.transform import Rotation

    back = rotation.swapaxes(-1, -2)
    inverse = -np.einsum("pij,pj->pi", back, translation)
    # Of q = (x, y, z, w) read as x y z w, the rotation of w x y z, of the poses and of their inverses.
    first = Rotation.from_quat(Rotation.from_matrix(rotation).as_quat()[:, [1, 2, 3, 0]]).as_matrix()
    last = Rotation.from_quat(Rotation.from_matrix(back).as_quat()[:, [1, 2, 3, 0]]).as_matrix().swapaxes(-1, -2)
    return [
        ("had the quaternion's w first", first, translation),
        ("had the quaternion's w first", last, -np.einsum("pij,pj->pi", last, inverse)),
        ("were in mm", rotation, translation / 1000),
        ("held inverses in mm", back, inverse / 1000),
        ("were in mm, with the quaternion's w first", first, translation / 1000),
        ("were in mm, with the quaternion's w first", last, -np.einsum("pij,pj->pi", last, inverse) / 1000),
        ("held their inverses", back, inverse),
        ("were for a camera frame with y up and z backward", _FLIP @ rotation, translation @ _FLIP),
        ("held inverses for a camera frame with y up and z backward", _FLIP @ back, inverse @ _FLIP),
        ("were for a marker frame with y down and z into the face", rotation @ _FLIP, translation),
    ]
