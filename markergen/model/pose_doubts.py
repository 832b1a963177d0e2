"""Whether poses seem to follow another convention than the one they are read by."""
# tests: tests/api/test_inspect.py tests/read/test_pose_conventions.py tests/model/test_poses.py

import numpy as np

from markergen.arrays import Array

_FLIP = np.diag([1.0, -1.0, -1.0])
WIDEST = np.deg2rad(120)
"""Field of view in rad that a camera is taken to have where none is known."""
USUAL, SURE = 0.8, 0.95
"""Shares of poses that look at the marker: fewer are doubted if more do by another convention. Inverses of poses on a
cone, and those with a quaternion in another order, look at it in 35 to 65 % of cases, as tried with 8 cones."""
FARTHEST = 50.0
"""Largest plausible distance in m of half of the poses: of a marker of 2 m, 10 px with a focal length of 250 px."""


def plausibility(rotation: Array, translation: Array) -> str:
    """Return what is odd about poses whatever camera and marker they are for; or an empty string."""
    share = _looking(rotation, translation)
    if share < USUAL:
        # Directions do not depend on the unit.
        trials = [trial for trial in other_conventions(rotation, translation) if " mm" not in trial[0]]
        shares = [_looking(*poses) for _, *poses in trials]
        best = int(np.argmax(shares))
        least = f"{share:.0%} of the poses look at the marker's front"
        if shares[best] > max(2 * share, 0.1) or shares[best] > SURE:
            words = f"{shares[best]:.0%} would if the file {trials[best][0]}"
            return f"{least}; {words}: look up which way its format goes"
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
    # Of q = (x, y, z, w) read as x y z w, the turn of w x y z, of the poses and of their inverses.
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
