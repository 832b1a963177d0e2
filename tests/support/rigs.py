"""Rigs for tests, and what rays find of them."""

from dataclasses import replace

import numpy as np

from markergen.maths.rotation import exponential
from markergen.model.body import Plate
from markergen.model.boundary import polygon_from
from markergen.model.marker import build_marker
from markergen.model.rig import Rig
from markergen.model.rig_shapes import rig_shape


def rectangle(width, height):
    return polygon_from([np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]])


def face(axis, sign):
    """Rotation whose z axis is that of the rig, in one of its two directions."""
    across, out = np.eye(3)[(axis + 1) % 3], sign * np.eye(3)[axis]
    return np.stack([np.cross(across, out), across, out], axis=1)


def plate(seed, width=0.08, height=0.08, n=6, diameter=0.012):
    """Marker with dots at random places of a rectangle."""
    rng = np.random.default_rng(seed)
    points = []
    while len(points) < n:
        point = rng.uniform(-1, 1, 2) * (np.array([width, height]) / 2 - 0.7 * diameter)
        if all(np.hypot(*(point - item)) > 1.4 * diameter for item in points):
            points.append(point)
    return build_marker(np.array(points), rectangle(width, height), diameter, diameter / 10)


def mounted(markers, rotations, translations):
    rows = zip(markers, rotations, translations, strict=True)
    return Rig(tuple(Plate(f"plate {k}", m, r.tolist(), tuple(t)) for k, (m, r, t) in enumerate(rows)))


def cube(edge=0.08, seed=0, **of_plates):
    turns = [face(axis, sign) for axis in range(3) for sign in (1, -1)]
    markers = [plate(seed + k, edge, edge, **of_plates) for k in range(6)]
    return mounted(markers, turns, [rotation[:, 2] * edge / 2 for rotation in turns])


def wall(columns=3, rows=2, pitch=0.13):
    places = [[pitch * x, pitch * y, 0] for y in range(rows) for x in range(columns)]
    return mounted([plate(k) for k in range(len(places))], [np.eye(3)] * len(places), places)


def rig_of(text, **measures):
    """Rig of a shape whose faces have the same dots, turned a little from one to the next."""
    dots = 0.001 * np.array([[14, 13], [-13, 12], [-12, -14], [11, -13], [2, 3]])
    shape = rig_shape(text, **measures)
    faces = shape.faces
    turns = exponential(np.array([[0, 0, 0.1 * k] for k in range(len(faces))]))[:, :2, :2]
    return Rig(
        tuple(
            face.mounted(
                replace(
                    build_marker(dots @ rotation.T, face.boundary, diameter=0.005, clearance=0.001),
                    substrate=shape.substrate,
                )
            )
            for face, rotation in zip(faces, turns, strict=True)
        )
    )


def corner(inward):
    """Two plates that meet at a right angle: the inside of a corner, or the outside."""
    turns = [face(2, 1), face(0, 1)]
    return mounted([plate(0), plate(1)], turns, [[0.04 if inward else -0.04, 0, 0], [0, 0, 0.04 if inward else -0.04]])


def scattered(seed, count=4):
    """Plates at random places and turns, of which some hide others and none touch."""
    rng = np.random.default_rng(seed)
    turns = exponential(rng.normal(size=(count, 3)))
    return mounted([plate(k) for k in range(count)], turns, 0.13 * np.arange(count)[:, None] * [0.4, 0.2, 1])


def first_hits(rig, eye, ways):
    """Plate (m,) that each ray from an eye (3,) along ways (m, 3) meets first, -1 for none, and where in its frame."""
    nearest, owner, places = np.full(len(ways), np.inf), np.full(len(ways), -1), np.zeros((len(ways), 2))
    for k, (item, margin) in enumerate(zip(rig.markers, rig.margins, strict=True)):
        start, way = item.to_marker(eye), ways @ item.rotation_matrix
        with np.errstate(divide="ignore", invalid="ignore"):
            far = -start[2] / way[:, 2]
        place = start[:2] + far[:, None] * way[:, :2]
        corner = item.marker.boundary.outlines()[0].max(axis=0)
        outside = np.linalg.norm(np.maximum(np.abs(place) - corner, 0), axis=-1)
        hit = (far > 0) & (outside <= margin) & (far < nearest - 1e-9)
        nearest[hit], owner[hit], places[hit] = far[hit], k, place[hit]
    return owner, places


def looking(rig, rng, distance=(0.25, 0.4)):
    """Random pose T_camera_rig from the side to which a rig's plates face."""
    toward = np.mean([marker.rotation_matrix[:, 2] for marker in rig.markers], axis=0) + rng.normal(0, 0.25, 3)
    back = -toward / np.linalg.norm(toward)
    right = np.cross(rng.normal(size=3), back)
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(back, right), back])
    return rotation, np.array([0, 0, rng.uniform(*distance)]) - rotation @ rig.xyz.mean(axis=0)
