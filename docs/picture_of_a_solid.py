"""Take a picture of a marker that was exported as GLB: sun, open sky, and a table under it.

python -m docs.picture_of_a_solid marker.glb solid.png
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array

Index = NDArray[np.int64]

FINER = 3
"""The picture is drawn this much larger, and then averaged."""
VIEWER, SUN = (0.25, 0.75, 1.0), (-0.8, 1.0, 0.35)
"""Where they are from the marker; x right, y up, z toward the viewer."""
SUNLIGHT, SKYLIGHT = 0.47, 0.4
"""What a white level surface sends back of them."""
SUN_SIZE, SUN_RAYS, SKY_RAYS = 0.06, 18, 54
"""Radius of the sun's disk in rad, larger than the real one for softer shadows, and how many rays go to each."""
TABLE = (0.62, 0.68, 0.76)


def read_glb(data: bytes) -> tuple[Array, Array]:
    """Corners (t, 3, 3) in m of all triangles, y up, and the color (t, 3) in linear light of each."""
    length = int.from_bytes(data[12:16], "little")
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def values(number: int) -> NDArray[np.generic]:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        kind, width = {5126: ("<f4", 3), 5125: ("<u4", 1)}[accessor["componentType"]]
        return np.frombuffer(binary, kind, accessor["count"] * width, view["byteOffset"])

    corners, colors = [], []

    def visit(number: int, outer: Array) -> None:
        node = document["nodes"][number]
        matrix = outer @ np.reshape(node.get("matrix", np.eye(4)), (4, 4)).T
        for primitive in document["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            points = values(primitive["attributes"]["POSITION"]).reshape(-1, 3).astype(float)
            triangles = values(primitive["indices"]).reshape(-1, 3)
            corners.append((points @ matrix[:3, :3].T + matrix[:3, 3])[triangles])
            material = document["materials"][primitive["material"]]
            colors.append(np.tile(material["pbrMetallicRoughness"]["baseColorFactor"][:3], (len(triangles), 1)))
        for child in node.get("children", []):
            visit(child, matrix)

    for root in document["scenes"][document["scene"]]["nodes"]:
        visit(root, np.eye(4))
    return np.concatenate(corners), np.concatenate(colors)


def picture(corners: Array, colors: Array, width: int, height: int) -> NDArray[np.uint8]:
    """Picture (height, width, 3), blue first, of triangles on a table; parallel projection."""
    below, middle = corners[..., 1].min(), (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    size = float(np.linalg.norm(corners - middle, axis=-1).max())
    corners = np.concatenate([corners, _table(middle, below, 9 * size)])
    colors = np.concatenate([colors, np.tile(TABLE, (2, 1))])
    edge, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(edge, other)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)

    axes = _axes(np.array(VIEWER))
    across = (corners[:-2] - middle) @ axes.T
    spread = np.abs(across[..., :2]).max(axis=(0, 1))
    scale = 0.92 * FINER * min(width / 2 / spread[0], height / 2 / spread[1])
    to_pixels = np.array([scale, -scale, -scale])
    corner_of_picture = np.array([width, height, 0]) * FINER / 2 - middle @ axes.T * to_pixels
    printed, depth = rasterize(corners @ axes.T * to_pixels + corner_of_picture, width * FINER, height * FINER)

    rows, columns = np.indices(printed.shape)
    points = (np.stack([columns, rows, depth], axis=-1) - corner_of_picture) / to_pixels @ axes
    facing = normals[printed]
    light = np.zeros(printed.shape)
    rng = np.random.default_rng(0)
    for directions, strength, cells in ((_sun(rng), SUNLIGHT, 1500), (_sky(rng), SKYLIGHT, 600)):
        for part in range(FINER**2):
            # Each of the samples that a pixel is made of has some of the rays.
            subset = np.s_[part // FINER :: FINER, part % FINER :: FINER]
            rays = directions[part :: FINER**2]
            places, normal = points[subset] + facing[subset] * size * 2e-3, facing[subset]
            lit = sum(
                np.clip(normal @ ray, 0, None) * reached(places, corners, ray, middle, 1.6 * size, cells)
                for ray in rays
            )
            # A level surface that nothing hides gets all of it.
            light[subset] += strength * lit / rays[:, 1].sum()
    linear = (colors[printed] * light[..., None]).reshape(height, FINER, width, FINER, 3).mean(axis=(1, 3))
    return np.round(255 * _gamma(linear))[..., ::-1].astype(np.uint8)


def reached(points: Array, corners: Array, direction: Array, middle: Array, reach: float, cells: int) -> Array:
    """How much of what comes from a direction gets to points (..., 3) past triangles: 0 or 1.

    The triangles are seen from there; what is behind what is seen is in the dark. So is nothing beyond `reach`.
    """
    axes, scale = _axes(direction), cells / (2 * reach)
    to_cells = np.array([scale, -scale, -scale])
    corner = np.array([cells / 2, cells / 2, 0.0]) - middle @ axes.T * to_cells
    _, nearest = rasterize(corners[:-2] @ axes.T * to_cells + corner, cells, cells)
    x, y, depth = np.moveaxis(points @ axes.T * to_cells + corner, -1, 0)
    column, row = np.round(x).astype(int), np.round(y).astype(int)
    seen = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
    return ~seen | (depth <= nearest[np.where(seen, row, 0), np.where(seen, column, 0)] + 1.0)


def rasterize(corners: Array, width: int, height: int) -> tuple[Index, Array]:
    """Which triangle (-1: none) is nearest in each pixel (height, width), and at which depth.

    Corners (t, 3, 3) are in pixels, with a depth that is linear over the picture. Row by row, a triangle covers what
    lies between its edges.
    """
    printed, nearest, planes = np.full(width * height, -1), np.full(width * height, np.inf), _planes(corners)
    low = np.clip(np.ceil(corners[..., 1].min(axis=1)), 0, height).astype(int)
    high = np.clip(np.ceil(corners[..., 1].max(axis=1)), 0, height).astype(int)
    for chunk in np.array_split(np.flatnonzero(high > low), max(1, len(corners) // 20_000)):
        triangle, row = _expand(chunk, low[chunk], high[chunk])
        a, b = corners[triangle], corners[triangle][:, [1, 2, 0]]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (row[:, None] - a[..., 1]) / (b[..., 1] - a[..., 1])
            crossing = np.where((share >= 0) & (share <= 1), a[..., 0] + share * (b[..., 0] - a[..., 0]), np.nan)
        left, right = np.fmin.reduce(crossing, axis=1), np.fmax.reduce(crossing, axis=1)
        first = np.clip(np.ceil(np.nan_to_num(left, nan=width)), 0, width).astype(int)
        last = np.clip(np.ceil(np.nan_to_num(right, nan=0)), first, width).astype(int)
        span, column = _expand(np.arange(len(triangle)), first, last)
        one = triangle[span]
        depth = np.einsum("ij,ij->i", planes[one], np.stack([column, row[span], np.ones_like(column)], 1))
        pixel = row[span] * width + column
        # The last of several values for one place stays: the nearest.
        order = np.argsort(-depth, kind="stable")
        order = order[depth[order] < nearest[pixel[order]]]
        nearest[pixel[order]], printed[pixel[order]] = depth[order], one[order]
    return printed.reshape(height, width), nearest.reshape(height, width)


def _planes(corners: Array) -> Array:
    """Depth of each triangle (t, 3) as a x + b y + c; of one seen from its edge, that of its nearest corner."""
    edge, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(edge, other)
    flat = np.abs(normal[:, 2]) < 1e-9
    slope = np.where(flat[:, None], 0.0, -normal[:, :2] / np.where(flat, 1.0, normal[:, 2])[:, None])
    offset = np.where(flat, corners[..., 2].min(axis=1), corners[:, 0, 2] - (slope * corners[:, 0, :2]).sum(axis=1))
    return np.concatenate([slope, offset[:, None]], axis=1)


def _expand(of: Index, first: Index, last: Index) -> tuple[Index, Index]:
    """Every whole number from first to before last, and what it is of."""
    count = last - first
    start = np.repeat(np.cumsum(count) - count, count)
    return np.repeat(of, count), np.arange(count.sum()) - start + np.repeat(first, count)


def _axes(direction: Array) -> Array:
    """Right, up and toward, as rows, for someone in that direction who looks here."""
    toward = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 1.0, 0.0] if abs(toward[1]) < 0.999 else [0.0, 0.0, -1.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _table(middle: Array, height: float, half: float) -> Array:
    square = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]) * half + [middle[0], height, middle[2]]
    return square[[[0, 1, 2], [0, 2, 3]]]


def _sun(rng: np.random.Generator) -> Array:
    axes = _axes(np.array(SUN))
    radius, angle = SUN_SIZE * np.sqrt(rng.uniform(size=SUN_RAYS)), 2 * np.pi * rng.uniform(size=SUN_RAYS)
    rays = axes[2] + radius[:, None] * (np.cos(angle)[:, None] * axes[0] + np.sin(angle)[:, None] * axes[1])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _sky(rng: np.random.Generator) -> Array:
    """Directions spread evenly over the upper half of a ball (a spiral)."""
    up = (np.arange(SKY_RAYS) + 0.5) / SKY_RAYS
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(SKY_RAYS) + rng.uniform()
    around = np.sqrt(1 - up**2)
    return np.stack([around * np.cos(angle), up, around * np.sin(angle)], axis=1)


def _gamma(linear: Array) -> Array:
    """Linear light as sRGB."""
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def write_picture(source: Path, target: Path, width: int) -> None:
    """Read a GLB and write its picture, which is two thirds as high as it is wide."""
    image = picture(*read_glb(source.read_bytes()), width, 2 * width // 3)
    target.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    print(f"{target}: {image.shape[1]} x {image.shape[0]} pixels")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path, nargs="?", default=Path("solid.png"))
    parser.add_argument("--width", type=int, default=1200, help="of the picture in pixels")
    arguments = parser.parse_args()
    write_picture(arguments.source, arguments.target, arguments.width)
