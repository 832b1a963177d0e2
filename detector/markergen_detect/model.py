"""Bodies as the compiled core takes them: flat arrays, and tables for guessing poses from pairs of dots."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen_detect.core import pointer, structures
from markergen_detect.description import Body, DescriptionError, Tag, root

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LEAST_DOTS, SCALE_RATIO, FLAT = 4, 1.5, 0.02
"""Least number of dots of a constellation; ratio of diameters, from one dot to the next larger one, from which on they
are of two; ratio of the spreads across and along a line below which dots count as on it."""
MANY_DOTS, NEAR_DOTS, PAIRED_DOTS = 16, 8, 3
"""Number of dots above which only neighbors form pairs; of a dot's neighbors that confirm a guess, and of those that it
forms pairs with."""
SHORTEST = 0.25
"""Least distance of few dots that form a pair, as a share of the largest: short ones determine the rotation badly."""
LARGEST_REACH = 2.0
"""Largest distance in radii of a dot within which a blob can be taken for it."""


@dataclass(frozen=True, eq=False)
class Model:
    """Bodies of one polarity, packed.

    Attributes
    ----------
    bodies : tuple of int
        Numbers of its members' bodies among all that are looked for.
    struct : array (1,)
        `Model` of the core.
    families : list of str
        Names of the families of tags.
    kept : list of array
        What the structures point to.
    """

    bodies: "tuple[int, ...]"
    struct: "NDArray[np.void]"
    families: "list[str]"
    kept: "list[NDArray[Any]]" = field(repr=False)


def pack(
    bodies: "Sequence[Body]",
    print_sigma: "float | None" = None,
    calibration: "Array | None" = None,
    scale_sigma: float = 0.0,
) -> "list[Model]":
    """Return the models of bodies with dark dots and of those with light ones, as far as there are any.

    Parameters
    ----------
    print_sigma : float or None
        Instead of the bodies' own, m.
    calibration : array (k, k) or None
        Covariance of the camera's parameters.
    scale_sigma : float
        Standard deviation of the scale of prints along x, and along y, as a fraction.
    """
    models = []
    for light in sorted({body.light for body in bodies}):
        kept: list[NDArray[Any]] = []
        chosen = tuple(k for k, body in enumerate(bodies) if body.light == light)
        families = _Families([tag for k in chosen for tag in bodies[k].tags])
        layouts, of = list[NDArray[np.void]](), dict[bytes, int]()
        members = np.zeros(len(chosen), structures()["Member"])
        for member, k in zip(members, chosen, strict=True):
            body = bodies[k]
            sigma = body.print_sigma if print_sigma is None else print_sigma
            key = b"".join(
                np.ascontiguousarray(part).tobytes() for part in (*_geometry(body), body.print_blocks(sigma))
            )
            if key not in of:
                of[key] = len(layouts)
                layouts.append(_layout(body, sigma, calibration, scale_sigma, kept))
            member["layout"], member["family"], member["tag"] = of[key], -1, -1
            for tag in body.tags[:1]:
                if tag.bits is not None:
                    member["family"], member["tag"], member["corners"] = *families.place(tag), tag.corners
        struct = np.zeros(1, structures()["Model"])
        packed = {"layouts": np.concatenate(layouts), "members": members, "families": families.packed(kept)}
        for name, count in (("layouts", "layout_count"), ("members", "member_count"), ("families", "family_count")):
            struct[name], struct[count] = pointer(packed[name]) or 0, len(packed[name])
        struct["light"] = light
        models.append(Model(chosen, struct, families.names, [*kept, *packed.values()]))
    return models


def _geometry(body: Body) -> "tuple[NDArray[Any], ...]":
    """What bodies have in common that differ by their tags alone."""
    return body.xyz, body.places, body.plates, body.rotations, body.translations, body.diameters, body.rings, body.ids


def _layout(
    body: Body, sigma: float, calibration: "Array | None", scale_sigma: float, kept: "list[NDArray[Any]]"
) -> "NDArray[np.void]":
    """Pack one body's geometry."""
    n = len(body.ids)
    dots, plates = np.zeros(n, structures()["Dot"]), np.zeros(len(body.rotations), structures()["Plate"])
    dots["xyz"], dots["place"], dots["normal"] = body.xyz, body.places, body.normals
    dots["radius"], dots["print"] = body.diameters / 2, body.print_blocks(sigma).reshape(n, 9)
    dots["ring"], dots["plate"], dots["id"] = body.rings, body.plates, body.ids
    plates["R"], plates["t"] = body.rotations.reshape(-1, 9), body.translations
    parts = list[NDArray[np.void]]()
    for index in constellations(body):
        dots["constellation"][index] = len(parts)
        parts.append(_constellation(body, index, kept))
    if not parts:
        raise DescriptionError(
            f"{body.name}: expected dots that span a plane on one of its plates, found them on a line"
        )
    layout = np.zeros(1, structures()["Layout"])
    packed = {"dots": dots, "plates": plates, "constellations": np.concatenate(parts)}
    kept.extend(packed.values())
    for name, array in packed.items():
        layout[name] = pointer(array)
    layout["count"], layout["plate_count"], layout["constellation_count"] = n, len(plates), len(parts)
    apart = _distances(body.xyz).min(axis=-1)
    layout["reach"] = min(LARGEST_REACH, 0.5 * float((apart / dots["radius"]).min()))
    layout["middle"] = middle = body.xyz.mean(axis=0)
    layout["extent"] = np.linalg.norm(body.xyz - middle, axis=-1).max()
    layout["print"] = np.sqrt(np.median(np.trace(dots["print"].reshape(n, 3, 3), axis1=1, axis2=2)) / 2)
    heights = (body.xyz - body.xyz[0]) @ body.normals[0]
    layout["flat"] = bool(len(plates) == 1 and np.ptp(heights) < 1e-9)
    layout["ringed"] = body.rings.any()
    if "errors" in (layout.dtype.names or ()):
        layout["errors"] = pointer(_errors(body, sigma, len(parts), calibration, scale_sigma, kept))
    return layout


def _errors(
    body: Body,
    sigma: float,
    parts: int,
    calibration: "Array | None",
    scale_sigma: float,
    kept: "list[NDArray[Any]]",
) -> "NDArray[np.void]":
    """Pack the errors that a body's dots have in common, and those of the camera."""
    errors, common = np.zeros(1, structures()["Errors"]), body.common_errors(sigma, scale_sigma)
    if common is not None:
        moved, alone = (np.ascontiguousarray(part) for part in common)
        errors["common"], errors["moved"], errors["alone"] = moved.shape[2], pointer(moved), pointer(alone)
        kept += [moved, alone]
    if calibration is not None:
        kept.append(np.ascontiguousarray(root(calibration)))
        errors["calibration"] = pointer(kept[-1])
    errors["several"] = parts > 1
    kept.append(errors)
    return errors


def constellations(body: Body) -> "list[Indices]":
    """Numbers of dots of one plate and about one size that span a plane; on each plate the largest first.

    All of a plate's dots if only one size has enough.
    """
    result = list[Indices]()
    for k in range(len(body.rotations)):
        own = np.flatnonzero(body.plates == k)
        order = own[np.argsort(-body.diameters[own], kind="stable")]
        steps = body.diameters[order[:-1]] >= SCALE_RATIO * body.diameters[order[1:]]
        scales = [np.sort(part) for part in np.split(order, np.flatnonzero(steps) + 1)]
        large = [part for part in scales if _spans(body.xyz[part])]
        result += large if len(large) > 1 else [own] if _spans(body.xyz[own]) else []
    return result


def _spans(points: Array) -> bool:
    if len(points) < LEAST_DOTS:
        return False
    size = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(size[1] > FLAT * size[0])


def _constellation(body: Body, index: Indices, kept: "list[NDArray[Any]]") -> "NDArray[np.void]":
    """Pack a constellation with its ordered pairs of dots, and the dots near each."""
    plate = int(body.plates[index[0]])
    points = (body.xyz[index] - body.translations[plate]) @ body.rotations[plate]
    n, rings, distance = len(index), body.rings[index], _distances(points)
    near = np.argsort(distance, axis=-1, kind="stable")[:, : min(n - 1, NEAR_DOTS)]
    paired = np.ones((n, n), dtype=bool)
    if n > MANY_DOTS:
        paired[:] = rings[:, None] | rings
        np.put_along_axis(paired, near[:, :PAIRED_DOTS], True, axis=1)
    np.fill_diagonal(paired, False)
    pairs = np.argwhere(paired)
    lateral = np.linalg.norm(points[pairs[:, 1], :2] - points[pairs[:, 0], :2], axis=-1)
    long = lateral > (SHORTEST * lateral.max() if n <= MANY_DOTS else 0)
    pairs, ratio = pairs[long], lateral[long] / (body.diameters[index[pairs[long, 0]]] / 2)
    order = np.argsort(ratio, kind="stable")
    arrays = {
        "dots": index.astype(np.int64),
        "points": points,
        "pairs": pairs[order].astype(np.int64),
        "ratio": ratio[order],
        "near": near.astype(np.int64),
    }
    part = np.zeros(1, structures()["Constellation"])
    for name, array in arrays.items():
        arrays[name] = np.ascontiguousarray(array)
        part[name] = pointer(arrays[name])
    kept.extend(arrays.values())
    part["plate"], part["count"], part["pair_count"], part["near_count"] = plate, n, len(pairs), near.shape[1]
    part["flat"] = np.ptp(points[:, 2]) < 1e-9
    part["sizes"] = np.log(body.diameters[index].max() / body.diameters[index].min())
    return part


def _distances(points: Array) -> Array:
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    return distance


class _Families:
    """Families of tags, and the codes of their inner cells: row by row from the lowest bit, 1 for black."""

    def __init__(self, tags: "Sequence[Tag]") -> None:
        self.names, self.codes, self.cells = list[str](), list[list[int]](), list[int]()
        for tag in tags:
            if tag.bits is not None and tag.family not in self.names:
                self.names.append(tag.family)
                self.codes.append(list(tag.codes))
                self.cells.append(len(tag.bits))

    def place(self, tag: Tag) -> "tuple[int, int]":
        """Return the number of a tag's family, and the row of its code."""
        assert tag.bits is not None
        family = self.names.index(tag.family)
        code, codes = code_of(tag.bits), self.codes[family]
        if len(tag.bits) != self.cells[family]:
            raise DescriptionError(f"two tags of {tag.family} have different numbers of cells")
        if code not in codes:
            codes.append(code)
        return family, codes.index(code)

    def packed(self, kept: "list[NDArray[Any]]") -> "NDArray[np.void]":
        """Return the families' structures."""
        if "TagFamily" not in structures():
            return np.zeros(0, "u1")
        families = np.zeros(len(self.names), structures()["TagFamily"])
        for family, codes, cells in zip(families, self.codes, self.cells, strict=True):
            table = np.array(codes, dtype=np.uint64)
            family["cells"], family["count"], family["codes"] = cells, len(table), pointer(table)
            kept.append(table)
        return families


def code_of(bits: "NDArray[np.bool_]") -> int:
    """Code of a tag's inner cells."""
    return sum(1 << i for i, black in enumerate(bits[1:-1, 1:-1].ravel().tolist()) if black)
