"""Dots, poses, cameras and blobs for tests, and calls of the core."""

import ctypes

import numpy as np
from markergen_detect.core import library
from structures import BLOB, BROWN_CONRADY, DOT, ESTIMATE, MATCH, PINHOLE, POSE, CameraStruct, ErrorsStruct

FOCAL, CENTER = np.array([800.0, 810.0]), np.array([322.0, 241.0])
RADTAN = (-0.2, 0.05, 1e-3, -5e-4, 0.01)
OUTLINE = np.dtype(
    [("center", "f8", 2), ("shape", "f8", 3), ("point", "f8", 2), ("depth", "f8"), ("facing", "f8"), ("seen", "i4")],
    align=True,
)


def pointer(array):
    return None if array is None else array.ctypes.data_as(ctypes.c_void_p)


def camera(coefficients=()):
    struct = CameraStruct(width=640, height=480, fx=FOCAL[0], fy=FOCAL[1], cx=CENTER[0], cy=CENTER[1], reach=2.0)
    struct.lens, struct.count = BROWN_CONRADY if coefficients else PINHOLE, len(coefficients)
    struct.c[: len(coefficients)] = coefficients
    return struct


def skew(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def turn(w):
    """Return exp([w]x)."""
    angle = np.linalg.norm(w) + 1e-300
    unit = skew(np.asarray(w) / angle)
    return np.eye(3) + np.sin(angle) * unit + (1 - np.cos(angle)) * unit @ unit


def facing_pose(rng, tilt=0.7, near=0.4, far=0.8):
    """Return a pose that sees the side z of a plane, tilted by up to `tilt` rad."""
    angle, around = rng.uniform(0, tilt), rng.uniform(0, 2 * np.pi)
    lean = turn(angle * np.array([np.cos(around), np.sin(around), 0]))
    rotation = lean @ np.diag([1.0, -1, -1]) @ turn([0, 0, rng.uniform(0, 2 * np.pi)])
    return rotation, np.array([*rng.uniform(-0.03, 0.03, 2), rng.uniform(near, far)])


def pose_of(rotation, translation, focal=1.0):
    pose = np.zeros(1, POSE)
    pose["R"], pose["t"], pose["focal"] = rotation, translation, focal
    return pose


def plate(rng, n, sigma=1e-4):
    """Return dots in the plane z = 0."""
    dots = np.zeros(n, DOT)
    dots["xyz"][:, :2] = rng.uniform(-0.05, 0.05, (n, 2))
    dots["place"], dots["normal"], dots["id"] = dots["xyz"], [0, 0, 1], np.arange(n)
    dots["radius"], dots["print"] = rng.uniform(0.002, 0.006, n), sigma**2 * np.diag([1, 1, 0])
    return dots


def rig(rng, n, sigma=1e-4):
    """Return dots of three sides of a cube, and a pose that sees them."""
    axes = [np.roll(np.eye(3), k, axis=0).T for k in range(3)]  # columns: x, y and normal of a side
    dots = np.concatenate([plate(rng, n) for _ in axes])
    for k, rotated in enumerate(axes):
        ours = slice(n * k, n * (k + 1))
        dots["place"][ours] = dots["xyz"][ours] = dots["xyz"][ours] @ rotated.T + 0.06 * rotated[:, 2]
        dots["normal"][ours], dots["plate"][ours] = rotated[:, 2], k
        dots["print"][ours] = sigma**2 * rotated @ np.diag([1, 1, 0]) @ rotated.T
    toward = np.ones(3) / np.sqrt(3)
    x = np.cross([0, 0, 1.0], toward)
    rotation = np.array([x / np.linalg.norm(x), np.cross(-toward, x / np.linalg.norm(x)), -toward])
    return dots, (turn(rng.uniform(-0.1, 0.1, 3)) @ rotation, np.array([*rng.uniform(-0.03, 0.03, 2), 0.6]))


def outlines(dots, pose, places=None):
    drawn = np.zeros(len(dots), OUTLINE)
    places = np.ascontiguousarray(dots["place"] if places is None else places)
    for i in range(len(dots)):
        library().outline_of(pointer(dots[i:]), pointer(places[i]), pointer(pose), pointer(drawn[i:]))
    return drawn


def pixels_of(struct, rays):
    pixels = np.zeros((len(rays), 2))
    for ray, pixel in zip(np.ascontiguousarray(rays), pixels, strict=True):
        library().lens_pixel(ctypes.byref(struct), pointer(ray), pointer(pixel), None)
    return pixels


def matched(n):
    matches = np.zeros(n, MATCH)
    matches["dot"] = matches["blob"] = np.arange(n)
    return matches


def blobs_of(struct, pixels, sigma):
    blobs = np.zeros(len(pixels), BLOB)
    blobs["center"], blobs["covariance"] = pixels, np.broadcast_to(sigma, len(pixels))[:, None] ** 2 * [1, 0, 1]
    blobs["semi"], blobs["reached"] = 5.0, 1
    for i in range(len(blobs)):
        library().undo_lens(ctypes.byref(struct), pointer(blobs[i:]), None, ctypes.c_int64(1))
    return blobs


def estimate(dots, blobs, struct, start, errors=None, matches=None):
    actual, matches = np.zeros(1, ESTIMATE), matched(len(blobs)) if matches is None else matches
    kept = library().estimate_pose(
        *(pointer(array) for array in (dots, blobs, matches)),
        ctypes.c_int64(len(matches)),
        ctypes.byref(struct),
        ctypes.byref(errors or ErrorsStruct()),
        pointer(start),
        pointer(actual),
    )
    return kept, actual[0], matches


def common_errors(rng, dots, count=3):
    """Return displacements (n, 3, count) of dots by a scale, and by turns of one plate."""
    moved = np.zeros((len(dots), 3, count))
    moved[:, :, 0] = 2e-3 * dots["place"]
    ours = dots["plate"] == 0
    for k in range(1, count):
        moved[ours, :, k] = np.cross(rng.normal(0, 3e-3, 3), dots["place"][ours] - dots["place"][ours].mean(axis=0))
    return moved
