"""Parts of a rig in the rig frame, in mm: a plate for each marker, or one block with the dots on its faces.

Markers whose boundaries are the whole faces of a polyhedron, and share its edges, make a block; faces without a marker
close it if their edges lie in one plane, such as the two ends of a prism. All other rigs are assemblies of plates.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.errors import InputError
from markergen.geometry.contour import Contour, area, flattened
from markergen.model.body import Plate
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.rig import Rig
from markergen.solid.primitives import OFF, BodyPart, Part, PosedPart, Primitive, Prism, at_height, mm
from markergen.units import format_length
from markergen.workshop.processes import FACE_DOWN, Made, parts_of

JOINED = 1e-3
"""Maximum distance in mm between corners of adjacent faces that are one vertex of a block."""

PARALLEL = 1e-6
"""Sine of the angle below which two edges count as parallel."""

COARSE = 0.05
"""Maximum distance in mm of chords from arcs, where plates are compared."""

MOST_CORNERS = 1000
"""Maximum number of corners of a face of a block."""

BODY = "body"
"""Name of the block among the parts."""

BARE = "face"
"""Names of faces without a marker: ``face-1`` and so on."""


@dataclass(frozen=True)
class BlockFace:
    """A face of a block, with the place of its marker's frame or, without a marker, one of its own, in the rig; mm.

    Attributes
    ----------
    name : str
        That of the marker, or ``face-1`` and so on.
    corners : tuple of (x, y)
        Counterclockwise as seen from outside.
    rotation, translation
        The pose of its frame.
    height : float
        z of the face in its frame: 0, or less for balls with their centers in the plane.
    """

    name: str
    corners: tuple[tuple[float, float], ...]
    rotation: tuple[tuple[float, ...], ...]
    translation: tuple[float, ...]
    height: float = 0.0

    @property
    def normal(self) -> Array:
        """Normal (3,) in the rig frame."""
        return np.array(self.rotation)[:, 2]

    def ring(self) -> Array:
        """Corners (m, 3) in the rig frame."""
        return at_height(np.array(self.corners), self.height) @ np.array(self.rotation).T + np.array(self.translation)


@dataclass(frozen=True)
class MadeBody:
    """A body as solids.

    Attributes
    ----------
    parts : tuple of Part or BodyPart
        The block, or the plates, first for each marker.
    made : tuple of Made
        What the process made for each marker.
    block : tuple of BlockFace
        Faces of the block, those of the markers first; empty for an assembly.
    overlap : str
        Which plates of an assembly overlap and by how much, in words; empty if none do.
    """

    parts: tuple[Part | BodyPart, ...]
    made: tuple[Made, ...]
    block: tuple[BlockFace, ...] = ()
    overlap: str = ""

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences for the user."""
        return tuple(dict.fromkeys(note for made in self.made for note in made.notes))


# Cached, since each file of a body needs its parts.
@lru_cache(maxsize=2)
def made_of(body: Marker | Rig, fabrication: Fabrication) -> MadeBody:
    """All parts of a body as designed, in its frame; needs no CAD kernel.

    Raises
    ------
    InputError
        If something is too small for the process or does not fit; one line.
    """
    body = body.as_designed
    if isinstance(body, Marker):
        made = parts_of(body, fabrication)
        return MadeBody(made.parts, (made,))
    if block := block_of(body):
        return _as_block(body, block, fabrication)
    plates = tuple(_named(plate, lambda marker: parts_of(marker, fabrication)) for plate in body.plates)
    parts = [
        BodyPart(f"{plate.name}/{part.name}", part.material, (PosedPart(part, plate.rotation, place),), part.volume)
        for plate, made in zip(body.plates, plates, strict=True)
        for place in [tuple(map(mm, plate.translation))]
        for part in made.parts
    ]
    return MadeBody(tuple(parts), plates, (), _overlap([part for part in parts if part.pieces[0].part.is_plate]))


def block_of(rig: Rig) -> tuple[BlockFace, ...]:
    """Faces of the block that the markers of a rig, as designed, enclose; empty if they do not enclose one."""
    rings = []
    for plate in rig.markers:
        contours = plate.marker.boundary.contours()
        if len(contours) > 1 or contours[0].has_arcs or len(contours[0].points) > MOST_CORNERS:
            return ()
        flat = at_height(1e3 * np.array(contours[0].points), 0.0)
        rings.append(flat @ plate.rotation_matrix.T + 1e3 * plate.translation_vector)
    vertices, index = _vertices(np.concatenate(rings))
    loops = np.split(index, np.cumsum([len(ring) for ring in rings])[:-1])
    bare = _bare(loops, vertices)
    if bare is None:
        return ()
    faces = [_face(plate.name, vertices[loop], plate) for plate, loop in zip(rig.markers, loops, strict=True)]
    faces += [_face(f"{BARE}-{k}", vertices[loop]) for k, loop in enumerate(bare, start=1)]
    return tuple(faces) if _is_convex(faces, vertices) else ()


def volume_of(block: Sequence[BlockFace]) -> float:
    """Volume in mm^3 of a block without its pockets, by the divergence theorem."""
    total = 0.0
    for face in block:
        # Each face is the base of a pyramid to the origin.
        total += float(face.ring()[0] @ face.normal) * area(Contour(face.corners)) / 3
    return total


def _vertices(points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Distinct points of (m, 3) mm, and the index of each point's; corners within `JOINED` are one."""
    from scipy.spatial import cKDTree

    first = np.array([min(neighbors) for neighbors in cKDTree(points).query_ball_point(points, JOINED)])
    distinct, index = np.unique(first, return_inverse=True)
    return points[distinct], index


def _bare(loops: Sequence[NDArray[np.intp]], vertices: Array) -> list[list[int]] | None:
    """Loops of vertices of the faces without a marker; None if faces do not share their edges, or one is not plane."""
    edges = [(int(a), int(b)) for loop in loops for a, b in zip(loop, np.roll(loop, -1), strict=True)]
    if len(set(edges)) < len(edges):
        return None
    # What is not shared by two faces bounds a bare one, whose edges run the other way.
    following = {b: a for a, b in edges if (b, a) not in set(edges)}
    if len(following) < sum((b, a) not in set(edges) for a, b in edges):
        return None
    bare = []
    while following:
        first = next(iter(following))
        loop, at = [first], following.pop(first)
        while at != first:
            if at not in following:
                return None
            loop.append(at)
            at = following.pop(at)
        points = vertices[loop] - vertices[loop].mean(axis=0)
        # The smallest singular value is the root of the sum of squared distances from the plane that fits best.
        if len(loop) < 3 or np.linalg.svd(points)[1][2] > JOINED:
            return None
        bare.append(loop)
    return bare


def _face(name: str, ring: Array, plate: Plate | None = None) -> BlockFace:
    """Make a face of its corners (m, 3) in the rig frame, in the frame of a marker or in one at its middle."""
    if plate is not None:
        rotation, translation = plate.rotation_matrix, 1e3 * plate.translation_vector
    else:
        translation = ring.mean(axis=0)
        # Newell's sum: twice the vector area, of any plane polygon.
        normal = np.sum(np.cross(ring - translation, np.roll(ring, -1, axis=0) - translation), axis=0)
        along = ring[1] - ring[0]
        z, x = normal / np.linalg.norm(normal), along / np.linalg.norm(along)
        rotation = np.column_stack([x, np.cross(z, x), z])
    # Sizes on drawings are 60 mm and not 59.99999999999999.
    flat = np.round(((ring - translation) @ rotation)[:, :2], 9) + 0.0
    return BlockFace(
        name, tuple(map(tuple, flat.tolist())), tuple(map(tuple, rotation.tolist())), tuple(translation.tolist())
    )


def _is_convex(faces: Sequence[BlockFace], vertices: Array) -> bool:
    """Tell whether all vertices lie behind all faces, and not all in one plane."""
    behind = np.array([_depths(face, vertices) for face in faces])
    return bool(behind.min() > -JOINED and behind.max(axis=1).min() > 1.0)


def _depths(face: BlockFace, points: Array) -> Array:
    """Distances (...,) of points (..., 3) of the rig frame behind the plane of a face, mm."""
    return np.asarray((face.ring()[0] - points) @ face.normal)


def _named(plate: Plate, make: Callable[[Marker], Made]) -> Made:
    """Make a marker; what is refused is told with the name of the marker."""
    try:
        return make(plate.marker)
    except InputError as error:
        expected, actual, remedy = error.args
        raise InputError(f"for the marker {plate.name} {expected}", actual, remedy) from None


def _as_block(rig: Rig, block: tuple[BlockFace, ...], fabrication: Fabrication) -> MadeBody:
    """Inlay the dots of all markers into the faces of a block."""
    made = tuple(_named(plate, lambda marker: _on_a_face(marker, fabrication)) for plate in rig.markers)
    block = _lowered(block, [plate_made.face for plate_made in made])
    _check_inlays(block, made)
    pieces, inlays = [], []
    for face, plate_made in zip(block, (*made, *[Made()] * (len(block) - len(made))), strict=True):
        # This prism stands for the block under its face, and ends below all that is cut.
        prism = Prism(Contour(face.corners), (), face.height - 2 * plate_made.depth - 1, face.height)
        under = Part(BODY, "light", (prism, *plate_made.add), plate_made.cut, plate_made.marked)
        pieces.append(PosedPart(under, face.rotation, face.translation))
        inlays += [
            BodyPart(f"{face.name}/{part.name}", part.material, (replace(pieces[-1], part=part),), part.volume)
            for part in plate_made.parts
        ]
    volume = volume_of(block) + sum(plate.part.volume - plate.part.add[0].volume for plate in pieces)
    return MadeBody((BodyPart(BODY, "light", tuple(pieces), volume), *inlays), made, block)


def _on_a_face(marker: Marker, fabrication: Fabrication) -> Made:
    """What a process makes of a marker on a face of a block, which is its plate."""
    plate = marker.substrate
    if plate.holes or plate.outline is not None or plate.chamfer or plate.corner_radius:
        actual = "holes, an outline, a chamfer or rounded corners"
        raise InputError("the plain face of a block", actual, "leave them out: the rig is made as one block")
    try:
        on_face = replace(marker, substrate=replace(plate, outline=marker.boundary))
        made: Made = PROCESSES[fabrication.process](on_face, replace(fabrication, engrave=False))
    except InputError as error:
        expected, actual, remedy = error.args
        if "--outline" in remedy:
            raise InputError(
                expected, actual, "design it with a larger --clearance, or use another --process"
            ) from None
        raise
    if fabrication.through or not (made.parts or made.marked):
        raise InputError("dots inlaid, standing or engraved", "none", "use another --process: the rig is one block")
    return replace(made, lines=tuple(line for line in made.lines if line != FACE_DOWN))


def _lowered(block: Sequence[BlockFace], heights: Sequence[float]) -> tuple[BlockFace, ...]:
    """Move the first faces to heights in their frames: each corner to where the planes that met there meet."""
    if not any(heights):
        return tuple(block)
    moved = [replace(face, height=height) for face, height in zip(block, heights, strict=False)]
    moved += block[len(moved) :]
    normals, levels = np.array([face.normal for face in moved]), [float(f.ring()[0] @ f.normal) for f in moved]
    lowered = []
    for face, old in zip(moved, block, strict=True):
        corners = []
        for corner in old.ring():
            at = np.array([abs(float(_depths(other_face, corner))) < JOINED for other_face in block])
            # Three planes or more through a corner; more than three meet there up to rounding.
            corner = np.linalg.lstsq(normals[at], np.array(levels)[at])[0]
            corners.append(tuple(((corner - face.translation) @ np.array(face.rotation))[:2].tolist()))
        lowered.append(replace(face, corners=tuple(corners)))
    return tuple(lowered)


def _check_inlays(block: Sequence[BlockFace], made: Sequence[Made]) -> None:
    """Refuse what stands over the edge of a face, and pockets of two faces that may meet inside the block."""
    for face, plate_made in zip(block, made, strict=False):
        points = [_extent(body)[:, :2] for body in (*plate_made.cut, *plate_made.marked, *plate_made.add)]
        room = min((float(_inside(np.array(face.corners), extent).min()) for extent in points), default=np.inf)
        if room <= 0:
            raise InputError(
                f"dots that stand on the face of {face.name}",
                f"{-room:.3g} mm over its edge"
                + (f", since balls lower it by {-face.height:.4g} mm" * (face.height < 0)),
                "design it with smaller dots, or use another --process",
            )
    reach = [[_extent(body) for body in (*plate_made.cut, *plate_made.marked)] for plate_made in made]
    for a, b in combinations(range(len(made)), 2):
        rooms = []
        for cutting, facing in ((a, b), (b, a)):
            face = block[cutting]
            points = [extent @ np.array(face.rotation).T + np.array(face.translation) for extent in reach[cutting]]
            least = min((float(_depths(block[facing], extent).min()) for extent in points), default=np.inf)
            rooms.append(least - made[facing].depth - made[facing].face)
        if max(rooms) < 0:
            raise InputError(
                f"inlays of {block[a].name} and {block[b].name} that do not meet",
                f"{-max(rooms):.3g} mm in common at their edge",
                "use a smaller --depth, or design them with a larger --clearance",
            )


def _inside(corners: Array, points: Array) -> Array:
    """Distances (m,) of points (m, 2) from the nearest edge of a convex polygon (k, 2), negative outside of it."""
    steps = np.roll(corners, -1, axis=0) - corners
    inward = np.column_stack([-steps[:, 1], steps[:, 0]]) / np.linalg.norm(steps, axis=1, keepdims=True)
    return np.asarray(((points[:, None] - corners) * inward).sum(axis=-1).min(axis=1))


def _extent(body: Primitive, off: float = OFF) -> Array:
    """Points (m, 3) around a body, in mm, marker frame, with chords within a distance of its arcs."""
    flat = np.array(flattened(body.outline, off))
    return np.concatenate([at_height(flat, z) for z in body.span])


def check_no_overlap(made: MadeBody, body: Marker | Rig) -> None:
    """Refuse plates that overlap, which cannot be made."""
    if made.overlap:
        plate = body.plates[0].marker
        lengths = {"thickness": plate.substrate.thickness, "edge": plate.substrate.edge_around(plate.boundary)}
        options = " ".join(f"--{name} {format_length(length).replace(' ', '')}" for name, length in lengths.items())
        is_pair = body.provenance.get("shape") == "pair"
        remedy = "move them apart, or use a smaller --edge or --thickness"
        raise InputError(
            "plates apart from each other, or markers that are the whole faces of one body",
            made.overlap,
            f"{f'design the pair with {options}, which sets its plates back' if is_pair else remedy}; "
            "models to look at are written as they are",
        )


def _overlap(plates: Sequence[BodyPart]) -> str:
    """Say which two plates overlap; those with concave outlines are taken for their convex hulls.

    By the separating axes: two convex bodies are apart along the normal of one of their faces, or along the cross
    product of two of their edges.
    """
    hulls = [_hull(plate.pieces[0]) for plate in plates]
    middles = np.array([points.mean(axis=0) for points, _, _ in hulls])
    sizes = np.array([np.linalg.norm(points - points.mean(axis=0), axis=1).max() for points, _, _ in hulls])
    for a, b in combinations(range(len(plates)), 2):
        if np.linalg.norm(middles[a] - middles[b]) >= sizes[a] + sizes[b]:
            continue
        (first_hull, normals, edges), (second_hull, more, others) = hulls[a], hulls[b]
        crossed = np.cross(edges[:, None], others[None]).reshape(-1, 3)
        axes = np.concatenate([normals, more, crossed[np.linalg.norm(crossed, axis=1) > PARALLEL]])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        mine, theirs = first_hull @ axes.T, second_hull @ axes.T
        common = np.minimum(mine.max(axis=0) - theirs.min(axis=0), theirs.max(axis=0) - mine.min(axis=0)).min()
        if common > JOINED:
            first, second = (plates[k].name.rpartition("/")[0] for k in (a, b))
            return f"the plates of {first} and {second} overlap by {common:.3g} mm"
    return ""


def _hull(piece: PosedPart) -> tuple[Array, Array, Array]:
    """Corners (m, 3) of a plate's convex hull in the rig frame, normals of its faces, and directions of its edges."""
    from scipy.spatial import ConvexHull

    body = piece.part.add[0]
    flat = _extent(body, COARSE)[:, :2]
    ring = flat[ConvexHull(flat).vertices]
    steps = np.roll(ring, -1, axis=0) - ring
    along = at_height(steps / np.linalg.norm(steps, axis=1, keepdims=True), 0.0)
    up = np.array([[0.0, 0.0, 1.0]])
    to_rig = np.array(piece.rotation).T
    return (
        piece.to_body(np.concatenate([at_height(ring, z) for z in body.span])),
        np.concatenate([up, np.cross(along, up)]) @ to_rig,
        np.concatenate([up, along]) @ to_rig,
    )
