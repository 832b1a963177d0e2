"""Closed form of hand-eye calibration: the start of `markergen.calibration.handeye`.

A robot's poses G_k = F M_k C^-1, M_k those of what moves with respect to the camera, up to their scale s. For two of
them, P = G_j^-1 G_i and Q = M_j^-1 M_i have P C = C Q, which is linear in s R_C and t_C,

    R_P (s R_C) = (s R_C) R_Q,    (R_P - I) t_C - (s R_C) t_Q = -t_P.

Of all pairs together, this gives R_C also where rotations are about one axis, if the robot moves, too; t_C and s follow
from the second equation with R_C, and F from all poses.
"""

# tests: tests/estimators/test_hand_eye.py

from itertools import combinations

import numpy as np

from markergen.arrays import Array
from markergen.maths.rotation import inverse_pose, pose_product

Pose = tuple[Array, Array]

WEAKLY = 1e-6
"""Weight of a scale of 1, beside that of a pose: it decides only where nothing else does."""


def hand_eye_start(robot: Pose, moving: Pose) -> tuple[Pose, Pose, float]:
    """F, C and s by linear least squares over all pairs of poses; the least where they are open.

    Parameters
    ----------
    robot, moving : (array (k, 3, 3), array (k, 3)), m
        G and M, k >= 2.
    """
    first, second = np.array(list(combinations(range(len(robot[0])), 2))).T
    moved, seen = (
        pose_product(inverse_pose((poses[0][second], poses[1][second])), (poses[0][first], poses[1][first]))
        for poses in (robot, moving)
    )
    length = float(np.sqrt(np.mean(moved[1] ** 2))) or 1.0
    eye, pairs = np.eye(3), len(first)
    rows, goal = np.zeros((pairs, 12, 12)), np.zeros((pairs, 12))
    # Row by row, entry (i, j) of A B C has the derivative A_ik C_lj by B_kl.
    turns = np.einsum("nik,lj->nijkl", moved[0], eye) - np.einsum("ik,nlj->nijkl", eye, seen[0])
    rows[:, :9, :9] = turns.reshape(pairs, 9, 9)
    rows[:, 9:, :9] = np.einsum("ik,nl->nikl", eye, -seen[1] / length).reshape(pairs, 3, 9)
    rows[:, 9:, 9:], goal[:, 9:] = moved[0] - eye, -moved[1] / length
    solution = np.linalg.lstsq(rows.reshape(-1, 12), goal.ravel(), rcond=1e-9)[0]
    carried = _rotation_near(np.asarray(solution[:9]).reshape(3, 3))
    rows = np.concatenate([moved[0] - eye, -(seen[1] @ carried.T)[..., None]], axis=-1)
    # Where all poses are as far from one point, s is open, and 1 the best guess.
    rows, goal = np.vstack([rows.reshape(-1, 4), [0, 0, 0, WEAKLY * length]]), np.r_[-moved[1].ravel(), WEAKLY * length]
    *place, scale = np.linalg.lstsq(rows, goal, rcond=1e-9)[0]
    scale = float(scale) if scale > 0 else 1.0
    C = carried, np.array(place)
    F = pose_product(pose_product(robot, C), inverse_pose((moving[0], scale * moving[1])))
    return (_rotation_near(F[0].mean(axis=0)), F[1].mean(axis=0)), C, scale


def _rotation_near(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)
