"""The detector, built once and called for every frame, and what it finds."""

import ctypes
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from markergen_detect.camera import Camera, CameraLike
from markergen_detect.core import constants, library, pointer, struct, structures, words
from markergen_detect.description import Body, DescriptionError, Source, read_bodies
from markergen_detect.model import Model, pack
from markergen_detect.verdict import Verdict, read_verdict

Array = NDArray[np.float64]

MOST_COPIES, MOST_BLOBS, MOST_STEPS = 32, 4096, 48_000
"""Largest numbers of copies of a body, of blobs that are looked at, and of steps of a search for a body.

In 690 mixed views of one to three bodies, 1,000,000 steps find no more, and of 613 steep, covered, crowded or tiny
markers 3 more; 30,000 find 7 fewer of these, and miss 2 of 360 markers of 5 to 12 dots beside 40 like dots of another
one, 15,000 miss 19. Keyboards take 4.5 times as long as a photograph with the marker, with 30,000 four times.
"""
LARGEST_IMAGE = 2**28
"""Largest number of pixels."""
_MEMORY = "not enough memory to search this image"

STATES = words("FOUND", "CONTRADICTED")
"""Names of the core's states, in its order."""

TAG_STATES = (*(name.removeprefix("tag ") for name in words("TAG_READ", "TAG_UNCLEAR")), "none")
"""What became of a body's tag, in the core's order; the last one stands for -1: it has none."""

_PLAIN = [
    "member", "state", "cut", "tag_state", "tag_family", "tag_place", "rival", "tag", "turns", "misplaced", "count",
    "missing", "evidence", "margin", "sigma", "dots", "blobs", "pixels", "dropped", "plane", "bend",
]  # fmt: skip
"""Fields of the core's `Finding` that are single numbers."""
_INTEGER, _REAL = np.dtype("i8"), np.dtype("f8")
_NUMBERS, _PLACES = np.zeros(0, _INTEGER), np.zeros((0, 2))


class Second(NamedTuple):
    """Another pose from which a flat body looks much the same, with its likelihood relative to the first one."""

    rotation: Array
    translation: Array
    likelihood_ratio: float


class Finding(NamedTuple):
    """What was found of one body in one frame, or why it was not.

    Attributes
    ----------
    ok : bool
        True if dots have unique labels.
    state : str
        ``found``, or the reason: see `STATES`.
    facts : dict
        Numbers of the reason: ``count`` dots of the best labeling, ``missing`` ones that should be seen, ``blobs`` in
        the image, ``rival``, the number of another body, ``cut``, whether the search was.
    body : int
        Number of the body among those that are looked for; `name` is its name.
    ids : array (k,) of int
        Ids of the dots; empty if labels are ambiguous.
    pixels, pixel_covariance : arrays (k, 2), px, and (k, 2, 2), px^2
        Images of the dots' own centers in the image as taken; also if labels are ambiguous.
    ellipse_centers : array (k, 2), px
        Centers of the dots' outlines, from which `pixels` were corrected.
    guess : array (k,) of int
        Ids by the best labeling, if labels are ambiguous; else `ids`.
    dropped : array of int
        Ids of dots that lie farther from their places than any error explains.
    rotation, translation : arrays (3, 3) and (3,), m, or None
        T_camera_body: X_camera = R X_body + t; None without a camera.
    covariance : array (6, 6) or None
        Of (w, dt), rad and m: R <- exp([w]x) R, t <- t + dt; the sum of the next three.
    image_covariance, print_covariance, camera_covariance : arrays (6, 6) or None
    second : Second or None
    homography : array (3, 3) or None
        From (x, y) of a flat body, m, to px of an image without lens distortion.
    chi2, degrees_of_freedom, scale : float, int, float
        Of the residuals; `scale` is the factor on the covariances of image and print by which residuals exceed them.
    misfit : float
        RMS by which the dots miss their places, px.
    evidence, margin : float
        Logarithms of the likelihood ratio to clutter, and to the next other labeling.
    tag_state : str
        ``read``, or why not: see `TAG_STATES`.
    tag_corners : array (4, 2), px, or None
        Of the tag that was read, in the order of its description.
    turns : array (k,), rad
        By which other labelings that are about as likely are turned about the plate's normal.
    placed : void or None
        The core's own form of the pose, for the next frame.
    verdict : Verdict or None
        Whether image, camera and body agree.
    bend : float
        Without a camera, RMS by which the dots miss the homography because the lens bends it, px; 0 if that does not
        show, or there are fewer than 16 dots.
    tracked : bool
        True if only the surroundings of where it was were looked at.
    """

    ok: bool
    state: str
    facts: "dict[str, Any]"
    body: int
    name: str
    ids: "NDArray[np.int64]" = _NUMBERS
    pixels: Array = _PLACES
    pixel_covariance: Array = _PLACES.reshape(0, 2, 2)
    ellipse_centers: Array = _PLACES
    guess: "NDArray[np.int64]" = _NUMBERS
    dropped: "NDArray[np.int64]" = _NUMBERS
    rotation: "Array | None" = None
    translation: "Array | None" = None
    covariance: "Array | None" = None
    image_covariance: "Array | None" = None
    print_covariance: "Array | None" = None
    camera_covariance: "Array | None" = None
    second: "Second | None" = None
    homography: "Array | None" = None
    bend: float = 0.0
    chi2: float = 0.0
    degrees_of_freedom: int = 0
    scale: float = 0.0
    misfit: float = 0.0
    evidence: float = 0.0
    margin: float = 0.0
    tag_state: str = "none"
    tag_corners: "Array | None" = None
    turns: Array = _PLACES[:, 0]
    placed: Any = None
    verdict: "Verdict | None" = None
    tracked: bool = False

    @property
    def reason(self) -> str:
        """Why the body was not found, in one line; empty if it was."""
        if self.ok:
            return ""
        facts, count = self.facts, self.facts["count"]
        lines = {
            "few": f"found {facts['blobs']} dot{'s' * (facts['blobs'] != 1)} in the image, at least 4 are needed",
            "unfit": "no labeling fits"
            + f": the best has {count} dots" * (count > 0)
            + f", and {facts['missing']} more should be seen" * (count > 0 and facts["missing"] > 0),
            "unsure": f"the best labeling, of {count} dots, might be an accident",
            "ambiguous": "labels are ambiguous: another labeling of the same dots is about as likely",
            "claimed": "another body fits the same dots about as well",
            "mirrored": "the mirrored layout fits: is the image mirrored?",
            "other tag": _other_tag(facts.get("tags", [])),
            "hidden tag": "its tag cannot be read, and bodies of this layout differ by their tags alone",
            "contradicted": _misplaced(facts.get("misplaced", [])),
        }
        cut = "; the search was cut before its end" if facts["cut"] else ""
        return lines[self.state] + cut


class Detector:
    """Finds bodies in the frames of one camera; any number of threads may share one.

    Parameters
    ----------
    model : path, parsed JSON, `Body`, or several of these
        marker.detector.json, marker.json or rig.json.
    camera : `Camera`, dict or path of a JSON file, or None
        Without one there are labels, pixels and homographies of flat bodies, and no poses.
    print_sigma : float or None
        Standard deviation of printed dots along each axis, m; None for the files' own.
    camera_covariance : array (k, k) or None
        Of fx, fy, cx, cy and the lens's coefficients.
    copies : int
        Largest number of copies of each body.
    smallest : float
        Diameter of the smallest dots, px: larger ones are found faster in large images.
    symmetric : bool
        True to take any of several labelings that are about as likely; `Finding.turns` has the others.
    scale_sigma : float
        Standard deviation of the scale of the print along x, and along y, as a fraction; measured dots have none.

    Raises
    ------
    DescriptionError
        If a file or argument is wrong; the message is one line.

    Attributes
    ----------
    bodies : tuple of `Body`
    notes : tuple of str
        What the files do not have.
    """

    def __init__(
        self,
        model: "Source | Body | Sequence[Source | Body]",
        camera: "CameraLike | None" = None,
        *,
        print_sigma: "float | None" = None,
        camera_covariance: "Array | None" = None,
        copies: int = MOST_COPIES,
        smallest: float = 0.0,
        symmetric: bool = False,
        scale_sigma: float = 0.0,
    ) -> None:
        self.bodies = tuple(read_bodies(model))
        self.camera = None if camera is None else Camera.load(camera)
        self._settings: dict[str, Any] = {
            "print_sigma": print_sigma, "camera_covariance": camera_covariance, "copies": copies, "smallest": smallest,
            "symmetric": symmetric, "scale_sigma": scale_sigma,
        }  # fmt: skip
        if camera_covariance is not None and self.camera is not None:
            size = 4 + len(self.camera.coefficients)
            if np.shape(camera_covariance) != (size, size) or not np.isfinite(camera_covariance).all():
                actual = np.shape(camera_covariance)
                raise DescriptionError(f"expected a covariance of {size} x {size} numbers, found {actual}")
        if not (1 <= copies <= MOST_COPIES and np.isfinite(smallest)):
            raise DescriptionError(f"expected 1 to {MOST_COPIES} copies, and a diameter in px")
        for body in self.bodies:
            if self.camera is None and not body.flat:
                raise DescriptionError(f"{body.name}: expected a camera for a rig, or a marker with relief, found none")
        self._models = pack(self.bodies, print_sigma, None if camera is None else camera_covariance, scale_sigma)
        limits = {"blobs": MOST_BLOBS, "steps": MOST_STEPS, "copies": copies}
        self._options = struct("Options", [], **limits, smallest=smallest, symmetric=symmetric)
        self._packed = None if self.camera is None else self.camera.packed()
        self.notes = tuple(
            f"{body.name}: its tag {tag.family}:{tag.id} is not read, since the file has no bits: "
            "`markergen export -o marker.detector.json` writes them"
            for body in self.bodies
            for tag in body.tags
            if tag.bits is None
        )

    def __reduce__(self) -> "tuple[Any, ...]":
        # What is packed has addresses, which mean nothing in another process.
        return partial(Detector, **self._settings), (self.bodies, self.camera)

    def __call__(
        self, image: "NDArray[Any]", near: "Sequence[Finding]" = (), deadline: "float | None" = None
    ) -> "list[Finding]":
        """Find the bodies in a grey image: found ones first, then one finding with the reason for each other body.

        Parameters
        ----------
        image : array (h, w) of uint8 or uint16
        near : sequence of Finding
            The results for the frame before: if all were found, they are looked for where they were, and in the whole
            image only if one of them is not found again for certain.
        deadline : float or None
            Seconds after which nothing more is begun.

        Raises
        ------
        DescriptionError
            If it is no grey image, or of another size than the camera's.
        """
        camera = self._camera_of(image)
        findings = [finding for model in self._models for finding in self._find(model, image, camera, near, deadline)]
        return sorted(findings, key=lambda finding: (not finding.ok, -len(finding.ids)))

    def _camera_of(self, image: "NDArray[Any]") -> "NDArray[np.void]":
        if not isinstance(image, np.ndarray) or image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
            actual = f"{image.shape} of {image.dtype}" if isinstance(image, np.ndarray) else type(image).__name__
            raise DescriptionError(f"expected a grey image (h, w) of uint8 or uint16, found {actual}")
        height, width = image.shape
        if not 0 < image.size <= LARGEST_IMAGE:
            raise DescriptionError(f"expected an image of 1 to {LARGEST_IMAGE} pixels, found {width}x{height}")
        if self.camera is None or self._packed is None:
            focal = float(max(width, height))
            return Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2).packed()
        if (self.camera.width, self.camera.height) != (width, height):
            size = f"{self.camera.width}x{self.camera.height}"
            raise DescriptionError(f"the image is {width}x{height} px, the camera {size} px")
        return self._packed

    def _find(
        self,
        model: Model,
        image: "NDArray[Any]",
        camera: "NDArray[np.void]",
        near: "Sequence[Finding]",
        deadline: "float | None",
    ) -> "list[Finding]":
        kept, kinds = list[Any](), structures()
        options, tracks, findings = self._options, self._tracks(model, near), np.zeros(1, kinds["Findings"])
        if deadline is not None:
            options = options.copy()
            options["deadline"] = max(deadline, 1e-9)
        picture, at, calibrated = _picture(image, model.light, kept), pointer(findings), self.camera is not None
        inputs = model.at, pointer(camera), calibrated, pointer(picture), pointer(options), pointer(tracks), len(tracks)
        try:
            if library().detect_frame(*inputs, at) < 0:
                raise MemoryError(_MEMORY)
            count, blob_count, rows_at, blobs_at, tracked = findings.tolist()[0]
            rows, blobs = _copied(rows_at, kinds["Finding"], count), _copied(blobs_at, kinds["Blob"], blob_count)
            plain = [dict(zip(_PLAIN, values, strict=True)) for values in rows[_PLAIN].tolist()]
            return [
                self._finding(model, *pair, blobs, bool(tracked)) for pair in zip(rows[:, None], plain, strict=True)
            ]
        finally:
            library().findings_free(at)

    def _tracks(self, model: Model, near: "Sequence[Finding]") -> "NDArray[np.void]":
        """Where the bodies of a model were; none unless all findings for them say where."""
        own = [finding for finding in near if finding.body in model.bodies]
        tracks = np.zeros(len(own) if all(finding.placed is not None for finding in own) else 0, structures()["Track"])
        for track, finding in zip(tracks, own, strict=False):
            track["member"], track["count"] = model.bodies.index(finding.body), len(finding.ids)
            track["pose"] = finding.placed
        return tracks

    def _finding(
        self, model: Model, row: "NDArray[np.void]", plain: "dict[str, Any]", blobs: "NDArray[np.void]", tracked: bool
    ) -> Finding:
        """Read a row (1,) of the core's findings; `plain` has its single numbers."""
        number, state = model.bodies[plain["member"]], STATES[plain["state"]]
        body, ok = self.bodies[number], state == "found"
        facts: dict[str, Any] = {name: plain[name] for name in ("count", "missing", "cut")} | {"blobs": len(blobs)}
        if plain["rival"] >= 0:
            facts["rival"] = model.bodies[plain["rival"]]
        if state == "other tag":
            facts["tags"] = [f"{tag.family}:{tag.id}" for tag in body.readable_tags[plain["tag_place"] :][:1]]
            facts["tags"] += [f"{model.families[plain['tag_family']]}:{plain['tag']}"]
        if plain["misplaced"]:
            names = [*body.plate_names, ""]
            columns = (row[name][0, : plain["misplaced"]].tolist() for name in ("plates", "places", "plate_turns"))
            facts["misplaced"] = [(names[k], names[place], np.degrees(a)) for k, place, a in zip(*columns, strict=True)]
        values: dict[str, Any] = {name: plain[name] for name in ("evidence", "margin")} | {
            "misfit": plain["sigma"], "tag_state": TAG_STATES[plain["tag_state"]], "tracked": tracked,
            "turns": row["turn"][0, : plain["turns"]],
        }  # fmt: skip
        if plain["tag_state"] == constants()["TAG_READ"]:
            values["tag_corners"] = row["corners"][0]
        count = plain["count"]
        if plain["pixels"] and count > 0:
            dots, images = (_copied(plain[name], _INTEGER, count + plain["dropped"]) for name in ("dots", "blobs"))
            ids, seen = body.ids[dots], blobs[images[:count]]
            values |= {
                "ids": ids[: count if ok else 0], "guess": ids[:count], "dropped": np.sort(ids[count:]),
                "pixels": _copied(plain["pixels"], _REAL, 2 * count).reshape(-1, 2),
                "pixel_covariance": _matrices(seen["covariance"]), "ellipse_centers": seen["center"],
                "homography": row["H"].reshape(3, 3) if plain["plane"] else None,
                "bend": plain["bend"], "placed": row["pose"][0] if ok else None,
            }  # fmt: skip
            if row["estimate"]["count"][0]:
                values |= _estimated(row["estimate"])
                values["verdict"] = read_verdict(row["verdict"], body.plate_names)
        return Finding(ok, state, facts, number, body.name, **values)


def _estimated(estimate: "NDArray[np.void]") -> "dict[str, Any]":
    """Fields of a finding from the core's estimate (1,)."""
    parts = {"": "covariance", "image_": "image", "print_": "print", "camera_": "calibration"}
    other, likelihood = estimate["other"], estimate["likelihood"].item()
    return {
        "rotation": estimate["pose"]["R"].reshape(3, 3),
        "translation": estimate["pose"]["t"][0],
        "second": Second(other["R"].reshape(3, 3), other["t"][0], likelihood) if likelihood > 0 else None,
        "chi2": estimate["chi2"].item(),
        "degrees_of_freedom": estimate["freedom"].item(),
        "scale": estimate["scale"].item(),
        **{f"{name}covariance": estimate[part].reshape(6, 6) for name, part in parts.items()},
    }


def _picture(image: "NDArray[Any]", light: Any, kept: "list[Any]") -> "NDArray[np.void]":
    if image.strides[1] != image.itemsize or image.strides[0] < 0:
        image = np.ascontiguousarray(image)
        kept.append(image)
    size = {"height": image.shape[0], "width": image.shape[1], "stride": image.strides[0], "wide": image.itemsize == 2}
    return struct("Image", kept, rows=image.ctypes.data, inverted=light, **size)


def _matrices(symmetric: Array) -> Array:
    """Symmetric matrices (m, 2, 2) of their entries xx, xy, yy (m, 3)."""
    return symmetric.take((0, 1, 1, 2), axis=1).reshape(-1, 2, 2)


class Dots(NamedTuple):
    """Outlines of dots of an image, which need not be a body's, fitted to the grey levels.

    Attributes
    ----------
    center, semi : arrays (m, 2), px, longer semi-axes first
    angle : array (m,), rad, of the longer axis from x
    covariance : array (m, 2, 2), px^2, of the centers
    """

    center: Array
    semi: Array
    angle: Array
    covariance: Array


def find_dots(image: "NDArray[Any]", light: bool = False, smallest: float = 0.0) -> Dots:
    """Find the dark, or light, dots of a grey image (h, w) of uint8 or uint16: those with an even outline."""
    kept, address = list[Any](), np.zeros(1, np.uint64)
    picture = _picture(image, light, kept)
    count = library().find_blobs(pointer(picture), smallest, MOST_BLOBS, pointer(address))
    if count < 0:
        raise MemoryError(_MEMORY)
    blobs, which = _copied(int(address[0]), structures()["Blob"], count), np.arange(count)
    library().blobs_free(ctypes.c_void_p(int(address[0]) or None))
    if library().fit_blobs(pointer(picture), None, pointer(blobs), pointer(which), count) < 0:
        raise MemoryError(_MEMORY)
    blobs = blobs[blobs["state"] == constants()["FITTED"]]
    return Dots(blobs["center"], blobs["semi"], blobs["angle"], _matrices(blobs["covariance"]))


def _copied(address: Any, kind: "np.dtype[Any]", count: Any) -> "NDArray[Any]":
    """Copy an array that the core has allocated."""
    if not address or count <= 0:
        return np.zeros(0, kind)
    return np.frombuffer(bytearray(ctypes.string_at(address, count * kind.itemsize)), kind)


def _other_tag(tags: "list[str]") -> str:
    """What is wrong with a body's tag: its own, and the one that was read."""
    if len(set(tags)) < 2:
        return "found its dots and its tag, which do not lie as they should: the print may be a mirrored one"
    return f"found a marker of this layout with the tag {tags[1]}, not {tags[0]}"


def _misplaced(plates: "list[tuple[str, str, float]]") -> str:
    """What is wrong with plates: each with the one in whose place it is, and the degrees by which it is turned."""
    places, lines = {name: place for name, place, _ in plates}, []
    for name, place, turn in plates:
        if place == name:
            lines.append(f"{name} looks " + ("mirrored" if np.isnan(turn) else f"turned by {turn:.0f} deg"))
        elif place and places.get(place) == name:
            lines += [f"{name} and {place} exchanged"] if name < place else []
        else:
            lines.append(f"{name} is in the place of {place}" if place else f"{name} is where no plate should be")
    return "the body is not put together as described: " + ", ".join(lines)
