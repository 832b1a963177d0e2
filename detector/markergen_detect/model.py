"""Bodies as the compiled core takes them: flat arrays, and tables for guessing poses from pairs of dots."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen_detect.core import pointer, struct, structures
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

    @cached_property
    def at(self) -> int:
        """Address of the structure."""
        return pointer(self.struct)

    @cached_property
    def light(self) -> bool:
        """Whether the dots are light."""
        return bool(self.struct["light"][0])


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
        layouts, of, families = list[NDArray[np.void]](), dict[bytes, int](), dict[str, tuple[int, list[int]]]()
        members = list[NDArray[np.void]]()
        for k in chosen:
            body = bodies[k]
            sigma = body.print_sigma if print_sigma is None else print_sigma
            blocks = body.print_blocks(sigma)
            key = b"".join(np.ascontiguousarray(part).tobytes() for part in (*_geometry(body), blocks))
            if key not in of:
                of[key] = len(layouts)
                layouts.append(_layout(body, blocks, _errors(body, sigma, calibration, scale_sigma, kept), kept))
            tags = [np.zeros(0, structures()["Tag"])]
            for tag in body.readable_tags:
                family, code = _place(tag, families)
                tags.append(struct("Tag", kept, family=family, code=code, corners=tag.corners))
            members.append(struct("Member", kept, layout=of[key], tag_count=len(tags) - 1, tags=np.concatenate(tags)))
        tables = [
            struct("TagFamily", kept, cells=cells, count=len(codes), codes=np.array(codes, dtype=np.uint64))
            for cells, codes in families.values()
        ]
        packed = struct(
            "Model", kept, light=light, layout_count=len(layouts), layouts=np.concatenate(layouts),
            member_count=len(members), members=np.concatenate(members), family_count=len(tables),
            families=np.concatenate(tables or [np.zeros(0, structures()["TagFamily"])]),
        )  # fmt: skip
        models.append(Model(chosen, packed, list(families), kept))
    return models


def _geometry(body: Body) -> "tuple[NDArray[Any], ...]":
    """What bodies have in common that differ by their tags alone."""
    return body.xyz, body.places, body.plates, body.rotations, body.translations, body.diameters, body.rings, body.ids


def _layout(body: Body, blocks: Array, errors: "NDArray[np.void]", kept: "list[NDArray[Any]]") -> "NDArray[np.void]":
    """Pack one body's geometry; `blocks` are the covariances (n, 3, 3) of its places."""
    n = len(body.ids)
    dots, plates = np.zeros(n, structures()["Dot"]), np.zeros(len(body.rotations), structures()["Pose"])
    dots["xyz"], dots["place"], dots["normal"] = body.xyz, body.places, body.normals
    dots["radius"], dots["print"] = body.diameters / 2, blocks.reshape(n, 9)
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
    errors["several"] = len(parts) > 1
    between = _distances(body.xyz)
    dots["neighbor"] = (between - dots["radius"]).argmin(axis=-1)
    middle, apart = body.xyz.mean(axis=0), between.min(axis=-1)
    return struct(
        "Layout", kept, count=n, dots=dots, plate_count=len(plates), plates=plates,
        constellation_count=len(parts), constellations=np.concatenate(parts), errors=errors,
        reach=min(LARGEST_REACH, 0.5 * float((apart / dots["radius"]).min())),
        middle=middle, extent=np.linalg.norm(body.xyz - middle, axis=-1).max(),
        print=np.sqrt(np.median(np.trace(blocks, axis1=1, axis2=2)) / 2),
        flat=body.flat, ringed=body.rings.any(),
    )  # fmt: skip


def _errors(
    body: Body, sigma: float, calibration: "Array | None", scale_sigma: float, kept: "list[NDArray[Any]]"
) -> "NDArray[np.void]":
    """Pack the errors that a body's dots have in common, and those of the camera."""
    values = {} if calibration is None else {"calibration": root(calibration)}
    common = body.common_errors(sigma, scale_sigma)
    if common is not None:
        values |= {"moved": common[0], "alone": common[1]}
    return struct("Errors", kept, common=0 if common is None else common[0].shape[2], **values)


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
    neighbors = np.argsort(distance, axis=-1, kind="stable")[:, : min(n - 1, NEAR_DOTS)]
    paired = np.ones((n, n), dtype=bool)
    if n > MANY_DOTS:
        paired[:] = rings[:, None] | rings
        np.put_along_axis(paired, neighbors[:, :PAIRED_DOTS], True, axis=1)
    np.fill_diagonal(paired, False)
    pairs = np.argwhere(paired)
    lateral = np.linalg.norm(points[pairs[:, 1], :2] - points[pairs[:, 0], :2], axis=-1)
    long = lateral > (SHORTEST * lateral.max() if n <= MANY_DOTS else 0)
    pairs, ratio = pairs[long], lateral[long] / (body.diameters[index[pairs[long, 0]]] / 2)
    order = np.argsort(ratio, kind="stable")
    return struct(
        "Constellation", kept, plate=plate, count=n, dots=index.astype(np.int64), points=points,
        pair_count=len(pairs), pairs=pairs[order].astype(np.int64), ratio=ratio[order],
        neighbor_count=neighbors.shape[1], neighbors=neighbors.astype(np.int64), flat=np.ptp(points[:, 2]) < 1e-9,
        sizes=np.log(body.diameters[index].max() / body.diameters[index].min()),
    )  # fmt: skip


def _distances(points: Array) -> Array:
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    return distance


def _place(tag: Tag, families: "dict[str, tuple[int, list[int]]]") -> "tuple[int, int]":
    """Return the number of a tag's family, and the row of its code; families have cells and codes, by name."""
    assert tag.bits is not None
    cells, codes = families.setdefault(tag.family, (len(tag.bits), list(tag.codes)))
    if len(tag.bits) != cells:
        raise DescriptionError(f"two tags of {tag.family} have different numbers of cells")
    code = code_of(tag.bits)
    if code not in codes:
        codes.append(code)
    return list(families).index(tag.family), codes.index(code)


def code_of(bits: "NDArray[np.bool_]") -> int:
    """Code of a tag's inner cells: row by row from the lowest bit, 1 for black."""
    return sum(1 << i for i, black in enumerate(bits[1:-1, 1:-1].ravel().tolist()) if black)
