"""What is looked for, in plain numbers: bodies of plates with dots and tags, as files describe them.

`marker.detector.json` (README.md describes it) holds all of it; marker.json and rig.json hold all but the tags' bits.
"""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Union

import numpy as np
from numpy.typing import NDArray

FORMAT, VERSION = "markergen-detector", 1
MARKER, RIG = "markergen-marker", "markergen-rig"
USUAL_PRINT = 1e-4
"""Standard deviation of a printed dot's place along each axis, m, where the file has none."""
MOST_DOTS, MOST_CELLS = 2_000, 10
_DOMINANT = 4.0
"""Variance of the scale of dots measured together, in that of their other motions, above which it is all of theirs."""

Source = Union[str, "os.PathLike[str]", Mapping[str, Any]]
Array = NDArray[np.float64]
_Part = tuple[str, Array, Array, Mapping[str, Any]]
"""A marker on a body: its name, T_body_plate, and the content of its marker.json."""


class DescriptionError(ValueError):
    """A file or argument that does not describe a body or a camera; the message is one line."""


@dataclass(frozen=True, eq=False)
class Tag:
    """A square tag of a body.

    Attributes
    ----------
    family : str
        Tags of one family have the same number of cells.
    id : int
    plate : int
    corners : array (4, 3)
        Of the black square in the body, m: top left, top right, bottom right, bottom left.
    bits : array (c, c) of bool, or None
        Black cells with the border, row 0 on top; None if the file has none: then the tag is not read.
    codes : tuple of int
        Codes of its family's tags, so that others are recognized: inner cells row by row from the lowest bit, 1 for
        black.
    """

    family: str
    id: int
    plate: int
    corners: Array
    bits: "NDArray[np.bool_] | None"
    codes: "tuple[int, ...]" = ()


@dataclass(frozen=True, eq=False)
class Body:
    """A marker or rig: n dots on plates.

    Attributes
    ----------
    name, frame : str
        `frame` is ``marker`` or ``rig``.
    light : bool
        True for light dots on a dark ground.
    rotations, translations : arrays (k, 3, 3) and (k, 3), m
        T_body_plate of the plates.
    plate_names : list of str
    ids, plates : arrays (n,) of int
    rings : array (n,) of bool
    diameters : array (n,), m
    xyz : array (n, 3), m
        Dots in the body; of a flat plate in one plane.
    places : array (n, 3), m
        The same as measured on the print.
    measured : array (n, 3, 3), m^2
        Covariances of `places` in the body; nan where the print was not measured.
    joint : list of (array (m,) of int, array (3 m, 3 m))
        Dots measured together, and their covariance in the body, m^2.
    relation : array (6 k, 6 k) or None
        Covariance of the plates' poses, (w, dt) in rad and m; None if exact.
    print_sigma : float
        Standard deviation of the place of dots that were not measured, m.
    tags : list of Tag
    """

    name: str
    frame: str
    light: bool
    rotations: Array
    translations: Array
    plate_names: "list[str]"
    ids: "NDArray[np.int64]"
    plates: "NDArray[np.int64]"
    rings: "NDArray[np.bool_]"
    diameters: Array
    xyz: Array
    places: Array
    measured: Array
    joint: "list[tuple[NDArray[np.int64], Array]]" = field(default_factory=list)
    relation: "Array | None" = None
    print_sigma: float = USUAL_PRINT
    tags: "list[Tag]" = field(default_factory=list)

    @property
    def normals(self) -> Array:
        """Normals (n, 3) of the dots' plates in the body."""
        return self.rotations[self.plates, :, 2]

    @property
    def readable_tags(self) -> "list[Tag]":
        """Tags whose bits are known, in the order in which the core has them."""
        return [tag for tag in self.tags if tag.bits is not None]

    @property
    def flat(self) -> bool:
        """Whether all dots are in one plane of one plate."""
        heights = (self.xyz - self.xyz[0]) @ self.normals[0]
        return len(self.rotations) == 1 and bool(np.ptp(heights) < 1e-9)

    def common_errors(self, sigma: float, scale_sigma: float = 0.0) -> "tuple[Array, Array] | None":
        """Errors that dots have in common, and those that each has alone; None if they err alone.

        Displacements (n, 3, c) by one standard deviation of each of c common errors, m, and covariances (n, 3, 3) of
        the places without these, m^2, with `sigma` for dots not measured; those have the scale of their printer, too,
        which is off by `scale_sigma` along x and y of all plates.
        """
        if not self.joint and self.relation is None and not scale_sigma:
            return None
        alone, moved, n = self._alone(sigma), [], len(self.ids)
        for dots, matrix in self.joint:
            alone[dots] = 0
            columns = np.zeros((n, 3, len(matrix)))
            columns[dots] = root(matrix).reshape(len(dots), 3, -1)
            moved.append(columns)
        if self.relation is not None:
            # A dot at R x + t on a plate whose pose is off by (w, dt) is off by w x R x + dt.
            rows, lever = np.zeros((n, 3, len(self.translations), 6)), self.places - self.translations[self.plates]
            row = np.arange(n)
            for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
                rows[row, i, self.plates, j], rows[row, i, self.plates, k] = lever[:, k], -lever[:, j]
                rows[row, i, self.plates, 3 + i] = 1
            moved.append(rows.reshape(n, 3, -1) @ root(self.relation))
        if scale_sigma:
            axes = self.rotations[self.plates]
            local = np.einsum("nji,nj->ni", axes, self.places - self.translations[self.plates])
            columns = scale_sigma * axes[:, :, :2] * local[:, None, :2]
            measured = np.array(np.isfinite(self.measured).all(axis=(1, 2)), dtype=bool)
            for dots, _ in self.joint:
                measured[dots] = True
            columns[measured] = 0
            moved.append(columns)
        return np.concatenate(moved, axis=-1), alone

    def print_blocks(self, sigma: float) -> Array:
        """Covariances (n, 3, 3) of single places, m^2, by which dots are weighted.

        Of dots measured together whose scale is known poorly, its error counts no more than any other of their motions:
        no weights compensate for it.
        """
        common = self.common_errors(sigma)
        if common is None:
            return self._alone(sigma)
        moved, alone = common
        blocks = alone + moved @ moved.swapaxes(1, 2)
        grown = self.places - self.places.mean(axis=0)
        grown = grown / max(float(np.linalg.norm(grown)), np.finfo(float).tiny)
        along = np.einsum("nij,nj->ni", alone, grown) + moved @ np.einsum("nic,ni->c", moved, grown)
        variances, growth = blocks.diagonal(axis1=1, axis2=2), float(np.sum(along * grown))
        usual = (variances.sum() - growth) / max(np.count_nonzero(variances) - 1, 1)
        if growth > _DOMINANT * usual:
            mixed = along[:, :, None] * grown[:, None]
            blocks += (growth + usual) * grown[:, :, None] * grown[:, None] - mixed - mixed.swapaxes(1, 2)
        return blocks

    def _alone(self, sigma: float) -> Array:
        """Covariances (n, 3, 3): as measured, else along the plate, and across it where the plate has relief."""
        axes = self.rotations[self.plates]
        local = np.einsum("nji,nj->ni", axes, self.places - self.translations[self.plates])
        height = np.abs(local[:, 2]) > 1e-9
        relief = np.bincount(self.plates, height, len(self.rotations))[self.plates] > 0
        spread = sigma**2 * np.stack([np.ones_like(relief), np.ones_like(relief), relief], axis=-1)
        usual = np.einsum("nij,nj,nkj->nik", axes, spread, axes)
        return np.where(np.isnan(self.measured), usual, self.measured)


def root(covariance: Array) -> Array:
    """Return L with L L' the covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0))


def read_bodies(source: "Source | Body | Sequence[Source | Body]") -> "list[Body]":
    """Read bodies from files, parsed JSON, or several of these.

    Raises
    ------
    DescriptionError
        If one is no marker.detector.json, marker.json or rig.json, or contradicts itself; the message is one line.
    """
    if isinstance(source, Body):
        return [source]
    if not isinstance(source, (str, os.PathLike, Mapping)):
        bodies = [body for part in source for body in read_bodies(part)]
        if not bodies:
            raise DescriptionError("expected one body or more, found none: say what to look for")
        return bodies
    name, folder, content = "body", Path(), source
    if not isinstance(content, Mapping):
        path = Path(content)
        content, name, folder = parsed(path), path.name.removesuffix(".json").removesuffix(".detector"), path.parent
    kind = content.get("format")
    try:
        if kind == FORMAT:
            if content.get("version") != VERSION:
                raise DescriptionError(f"version {content.get('version')!r} of {FORMAT} is not known to this release")
            return [_body(entry, content.get("tag_families", {})) for entry in content["bodies"]]
        if kind == RIG:
            return [_of_markers(name, "rig", _mounted(content, folder), content.get("relation_covariance"))]
        if kind == MARKER and content.get("plates"):
            return [_of_markers(name, "rig", _on_plates(content, name))]
        if kind == MARKER:
            return [_of_markers(name, "marker", [("marker", np.eye(3), np.zeros(3), content)])]
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        if isinstance(error, DescriptionError):
            raise
        missing = f"the key {error} is missing" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise DescriptionError(f"{name}: {missing}") from error
    raise DescriptionError(f"{name}: expected a marker.detector.json, marker.json or rig.json, found format {kind!r}")


def parsed(path: Path) -> "Mapping[str, Any]":
    """Parse a JSON file that holds an object."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise DescriptionError(f"{path} cannot be read: {' '.join(str(error).split())}") from error
    if not isinstance(content, Mapping):
        raise DescriptionError(f"{path}: expected a JSON object, found {type(content).__name__}")
    return content


def _numbers(value: Any, shape: "tuple[int, ...]", what: str) -> Array:
    array = np.array(value, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise DescriptionError(f"expected {' x '.join(map(str, shape))} finite numbers for {what}")
    return array


def _body(entry: "Mapping[str, Any]", families: "Mapping[str, Any]" = MappingProxyType({})) -> Body:
    dots, plates = entry["dots"], entry["plates"]
    n, k = len(dots), len(plates)
    relation, unmeasured = entry.get("relation_covariance"), np.full((3, 3), np.nan)
    body = Body(
        str(entry["name"]),
        str(entry.get("frame", "marker")),
        bool(entry.get("light", False)),
        _numbers([plate["rotation"] for plate in plates], (k, 3, 3), "the plates' rotations"),
        _numbers([plate["translation"] for plate in plates], (k, 3), "the plates' translations"),
        [str(plate.get("name", f"plate {i}")) for i, plate in enumerate(plates)],
        np.array([dot["id"] for dot in dots], dtype=np.int64),
        np.array([dot.get("plate", 0) for dot in dots], dtype=np.int64),
        np.array([dot["kind"] == "ring" for dot in dots], dtype=bool),
        _numbers([dot["diameter"] for dot in dots], (n,), "the dots' diameters"),
        _numbers([dot["xyz"] for dot in dots], (n, 3), "the dots' places"),
        _numbers([dot.get("place", dot["xyz"]) for dot in dots], (n, 3), "the dots' measured places"),
        np.array([unmeasured if dot.get("covariance") is None else dot["covariance"] for dot in dots], dtype=float),
        [
            (
                np.array(part["dots"], dtype=np.int64),
                _numbers(part["matrix"], (3 * len(part["dots"]),) * 2, "a joint covariance"),
            )
            for part in entry.get("joint_covariances", [])
        ],
        None if relation is None else _numbers(relation, (6 * k, 6 * k), "the covariance of the plates' poses"),
        float(entry.get("print_sigma", USUAL_PRINT)),
        [_tag(tag, families) for tag in entry.get("tags", [])],
    )
    _check(body)
    return body


def _tag(entry: "Mapping[str, Any]", families: "Mapping[str, Any]") -> Tag:
    bits = entry.get("bits")
    cells = None if bits is None else np.array(bits, dtype=bool)
    if cells is not None and not (cells.ndim == 2 and 3 <= len(cells) == len(cells.T) <= MOST_CELLS):
        raise DescriptionError(f"expected the bits of a tag as 3 to {MOST_CELLS} equal rows and columns of 0 and 1")
    codes = tuple(int(code, 16) for code in families.get(entry["family"], ()))
    corners = _numbers(entry["corners"], (4, 3), "a tag's corners")
    return Tag(str(entry["family"]), int(entry["id"]), int(entry.get("plate", 0)), corners, cells, codes)


def _check(body: Body) -> None:
    n, k = len(body.ids), len(body.rotations)
    errors = [
        (4 <= n <= MOST_DOTS, f"expected 4 to {MOST_DOTS} dots, found {n}"),
        (k > 0 and body.frame in ("marker", "rig"), "expected one plate or more, of a marker or rig"),
        (len(set(body.ids.tolist())) == n, "two dots have the same id"),
        (bool(((body.plates >= 0) & (body.plates < k)).all()), "a dot is on a plate that is not there"),
        (bool((body.diameters > 0).all()), "expected dots that can be seen, found one of diameter 0"),
        (
            np.allclose(body.rotations @ body.rotations.swapaxes(1, 2), np.eye(3), atol=1e-6),
            "a plate's rotation is none",
        ),
        (bool((np.linalg.det(body.rotations) > 0).all()), "a plate's rotation is a reflection"),
        (0 <= body.print_sigma <= 1, "expected a print_sigma of 0 to 1 m"),
        (all(0 <= tag.plate < k for tag in body.tags), "a tag is on a plate that is not there"),
        (all(len(d) and d.min() >= 0 and d.max() < n for d, _ in body.joint), "a joint covariance is of unknown dots"),
    ]
    for good, message in errors:
        if not good:
            raise DescriptionError(f"{body.name}: {message}")


def _mounted(content: "Mapping[str, Any]", folder: Path) -> "list[_Part]":
    """Markers of a rig.json, which are in it or in files beside it."""
    parts = []
    for entry in content["markers"]:
        pose, marker = entry["T_rig_marker"], entry.get("marker") or parsed(folder / entry["file"])
        parts.append((entry["name"], np.array(pose["rotation"]), np.array(pose["translation"]), marker))
    return parts


def _on_plates(content: "Mapping[str, Any]", name: str) -> "list[_Part]":
    """Markers of a marker.json whose dots, in its frame, stand on several plates."""
    place, parts = {point["id"]: point for point in content["control_points"]}, list[_Part]()
    if content.get("joint_covariance") or any(point.get("covariance") for point in place.values()):
        raise DescriptionError(
            f"{name}: dots of several plates were measured: write it as .detector.json with markergen"
        )
    for plate in content["plates"]:
        R, t = np.array(plate["pose"]["rotation"]), np.array(plate["pose"]["translation"])
        points = []
        for point in map(place.__getitem__, plate["control_points"]):
            z = point["z"] if point.get("designed_z") is None else point["designed_z"]
            x, y, z = ((np.array([point["x"], point["y"], z]) - t) @ R).tolist()
            points.append({**point, "x": x, "y": y, "z": round(z, 9), "designed_z": None})
        parts.append((plate["name"], R, t, {**content, "control_points": points, "tag": plate.get("tag")}))
    return parts


def _of_markers(name: str, frame: str, parts: "list[_Part]", relation: Any = None) -> Body:
    """Body of the contents of marker.json in their poses; the dots of several are numbered through."""
    dots: list[dict[str, Any]] = []
    joints, tags, lights, sigmas = [], [], set[bool](), []
    for k, (_, R, t, content) in enumerate(parts):
        points, first = content["control_points"], len(dots)
        spec = content.get("provenance", {}).get("spec")
        sigma = spec.get("print_sigma") if isinstance(spec, Mapping) else None
        sigmas.append(sigma if isinstance(sigma, float) and sigma > 0 else USUAL_PRINT)
        across = sigmas[-1] ** 2 if any(point["z"] for point in points) else 0
        for point in points:
            feature, place = point["feature"], [float(point[axis]) for axis in "xyz"]
            height = point.get("designed_z")
            dot = {"id": point["id"] if frame == "marker" else len(dots), "plate": k, "diameter": feature["diameter"]}
            dot |= {"kind": feature["kind"], "place": R @ place + t}
            dot["xyz"] = R @ (place if height is None else [*place[:2], height]) + t
            if point.get("covariance"):
                xx, xy, yy = point["covariance"]
                dot["covariance"] = R @ np.array([[xx, xy, 0], [xy, yy, 0], [0, 0, across]]) @ R.T
            lights.add(feature.get("polarity", "dark") == "light")
            dots.append(dot)
        joint = content.get("joint_covariance")
        if joint:
            row, axes, m = (
                {point["id"]: first + i for i, point in enumerate(points)},
                len(joint["axes"]),
                len(joint["order"]),
            )
            matrix = np.einsum(
                "ai,minj,bj->manb", R[:, :axes], np.reshape(joint["matrix"], (m, axes, m, axes)), R[:, :axes]
            )
            numbers = [row[number] for number in joint["order"]]
            joints.append({"dots": numbers, "matrix": matrix.reshape(3 * m, 3 * m)})
        if content.get("tag"):
            scale, tag = content.get("print_correction") or {"scale_x": 1, "scale_y": 1}, content["tag"]
            corners = np.array(tag["corners"]) * [scale["scale_x"], scale["scale_y"], 1] @ R.T + t
            tags.append(
                {"family": tag["family"], "id": tag["id"], "plate": k, "corners": corners, "bits": tag.get("bits")}
            )
    if len(lights) > 1:
        raise DescriptionError(f"{name}: expected dots all dark or all light, found both")
    plates = [{"name": title, "rotation": R, "translation": t} for title, R, t, _ in parts]
    body = {"name": name, "frame": frame, "light": lights == {True}, "plates": plates, "dots": dots, "tags": tags}
    errors = {"print_sigma": max(sigmas), "joint_covariances": joints, "relation_covariance": relation}
    return _body({**body, **errors})
