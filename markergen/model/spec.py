"""The spec: a user's request for a design, with the assumed image."""

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from math import comb, hypot, isfinite, sqrt
from numbers import Real
from typing import Any, Literal

from markergen.defaults import BLUR_PX, DARK, LIGHT, NOISE_GREY, PRINT_SIGMA
from markergen.errors import InputError, among, brief
from markergen.model.boundary import Boundary, Circle, area_without
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.goal import parse_goal, parse_target
from markergen.model.openings import check_plate
from markergen.model.poses import named_poses
from markergen.model.recorded_poses import RecordedPoses
from markergen.model.substrate import Substrate
from markergen.model.tag import Tag, place_tag

PIXEL_VARIANCE = 1 / 12
"""Variance of a uniform unit interval: added to the blur by the area of a pixel (px^2), to the noise by rounding."""


@dataclass(frozen=True)
class ImageNoise:
    """Image quality assumed by the image noise model.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the lens's Gaussian point spread, px, in addition to the pixel's own area.
    noise_grey : float
        Standard deviation of the noise before rounding, grey levels.
    contrast : float
        Grey levels between dot and ground.

    Raises
    ------
    InputError
        If blur or noise is negative or not finite, or the contrast is not above 0 and at most 255.
    """

    blur_px: float = BLUR_PX
    noise_grey: float = NOISE_GREY
    contrast: float = float(LIGHT - DARK)

    def __post_init__(self) -> None:
        for name in ("blur_px", "noise_grey"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise InputError(f"a {name} of 0 or more", f"{name}={value}", "give a finite number such as 0.7")
        if not 0 < self.contrast <= 255:
            raise InputError(
                "a contrast above 0 and at most 255 grey levels", f"contrast={self.contrast}", "give such a number"
            )

    @property
    def edge_px(self) -> float:
        """Standard deviation of an edge in the image, px: lens and pixel together."""
        return hypot(self.blur_px, sqrt(PIXEL_VARIANCE))

    @property
    def contrast_to_noise(self) -> float:
        """Ratio of the contrast to the noise, rounding included."""
        return self.contrast / hypot(self.noise_grey, sqrt(PIXEL_VARIANCE))

    @property
    def size_factor(self) -> float:
        """How much larger dots have to be to be found than at the usual blur: 1 + 0.45 (blur - 0.7 px), or 1.

        Five dots two diameters apart are found from 6 px on at a blur of up to 3 px, tilted by up to 30 deg, by
        ``python -m benchmarks.detection_quality blurred``. At a slant, blur fills the gaps between dots and the hole of
        the key ring: with 0.25, 14 of 300 views of the default poses, up to 70 deg, are missed at 3 px, with 0.45 none.
        """
        return max(1.0, 1 + 0.45 * (self.blur_px - BLUR_PX))

    @property
    def gap_factor(self) -> float:
        """How much farther apart images of dots have to be than at the usual blur; a gap is filled by its own blur."""
        return max(1.0, self.blur_px / BLUR_PX)

    def as_dict(self) -> dict[str, float]:
        """Return plain JSON values."""
        return asdict(self)

    def __str__(self) -> str:
        return f"blur {self.blur_px:g} px, noise {self.noise_grey:g} and contrast {self.contrast:g} grey levels"


USUAL_IMAGE = ImageNoise()

NOISE_MODELS = ("point", "image")

MOST_LOST, MOST_LOSSES = 3, 2000
"""Maximum number of dots that a layout may have to survive the loss of, and of sets of lost dots."""

MOST_RESTARTS = 10_000
"""Maximum number of random starts, which are all in memory at once."""

MOST_POINTS = 200
"""Maximum number of control points, for which a design takes minutes."""

AUTO = 0
"""Number of control points that stands for the best one."""

UNSET: Any = None
"""Placeholder for a default that depends on other attributes."""


@dataclass(frozen=True)
class Spec:
    """All inputs that determine a design; equal specs give equal markers, byte for byte.

    Attributes
    ----------
    n : int
        Number of control points, 4 to 200; `AUTO` is the best one (see `markergen.optimize.dot_count`).
    boundary : Boundary
    camera : Camera
    poses : str or RecordedPoses
        A preset or a cone as normalized text (see `Cone`), or poses read from a file.
    objective, aggregate, coordinates : str
        Quantity to minimize, a weighted sum or with bounds (see `parse_goal`); an empty aggregate is the objective's
        own default. Coordinates only matter to ``condition``.
    dot : float, "auto" or None
        Dot diameter in m; None: determined by camera and poses; ``auto``: by the predicted error of the objective.
    clearance : float or None
        Minimum gap around dots, m; None is a tenth of the dot's diameter.
    gap : float
        Smallest gap between dots in m, where it is larger than the clearance.
    seed : int
    restarts : int
        Number of random starts of the descent; 0 is the objective's own default.
    noise_model : str
        ``point``: image noise of 1 px on every control point. ``image``: predicted from the image of each dot in each
        pose. Empty is ``image`` for ``dot="auto"`` and ``point`` otherwise.
    image_noise : ImageNoise
        Image quality for ``image``.
    survive : int
        Minimize the objective after the worst loss of this many dots, 0 to 3.
    keep_outs : tuple of Boundary
        Regions without dots, such as mounting holes, in the marker frame.
    print_sigma : float
        Standard deviation in m of a printed dot's place along each axis, which ``image`` adds to the image's errors; 0
        is a perfect print, and the default unless the number of dots is open.
    asymmetric : float
        Minimum margin in px by which the layout alone must identify every dot, instead of a key ring; 0 uses a key
        ring.
    relief : float
        Maximum height in m of control points above the plane, each on a pillar; 0 is a flat marker.
    tag : str
        Square tag in the middle, such as ``aruco:DICT_4X4_50:7``; empty for none.
    tag_side : float or None
        Side of the tag's black square, m; None is a third of the radius, or less if room is short (see `place_tag`).
    substrate : Substrate
        Plate, if the marker is made as a solid; no dot lies on its holes.
    scale_sigma : float
        Standard deviation of the print's scale along x and y, as a fraction, for choosing the number of dots.
    camera_covariance : tuple of tuple of float or None
        Covariance of the camera's parameters, for the same; None is an exact calibration.
    target : str
        Error to reach with the smallest disk and the fewest dots, such as ``0.1deg@1.5m``; empty for none.
    points : tuple of tuple of float
        Control points to take as they are, n of x, y in m, or x, y, z of a relief; empty for a search.
    """

    n: int = 5
    boundary: Boundary = Circle(0.15)  # noqa: RUF009  (frozen, so it can be shared)
    camera: Camera = PAPER_CAMERA
    poses: str | RecordedPoses = "paper"
    objective: str = "pose"
    aggregate: str = ""
    coordinates: str = "unit"
    dot: float | Literal["auto"] | None = None
    clearance: float | None = None
    seed: int = 0
    restarts: int = 0
    noise_model: str = ""
    image_noise: ImageNoise = USUAL_IMAGE
    survive: int = 0
    keep_outs: tuple[Boundary, ...] = ()
    print_sigma: float = UNSET
    asymmetric: float = 0.0
    relief: float = 0.0
    tag: str = ""
    tag_side: float | None = None
    substrate: Substrate = Substrate()  # noqa: RUF009
    gap: float = 0.0
    scale_sigma: float = 0.0
    camera_covariance: tuple[tuple[float, ...], ...] | None = None
    target: str = ""
    points: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        if self.n < 4 and self.n != AUTO:
            raise InputError("at least 4 control points", f"n={self.n}", "a homography needs four: use --n 4 or more")
        if self.n > MOST_POINTS:
            raise InputError(f"at most {MOST_POINTS} control points", f"n={self.n}", "use a smaller --n")
        for name in ("dot", "clearance", "gap"):
            value = getattr(self, name)
            if value is None or value == "auto" == self.dot:
                continue
            if not (isfinite(value) and value >= 0):
                raise InputError(f"a {name} of 0 or more", f"{name}={value} m", f"give --{name} a length such as 5mm")
        if not 0 <= self.restarts <= MOST_RESTARTS:
            raise InputError(
                f"1 to {MOST_RESTARTS} restarts", f"restarts={self.restarts}", "use fewer, or leave it out"
            )
        if self.seed < 0:
            raise InputError("a seed of 0 or more", f"seed={self.seed}", "give a non-negative whole number")
        object.__setattr__(self, "objective", str(parse_goal(self.objective)))
        self._check_points()
        check_losses(self.n or MOST_LOST + 4, self.survive)
        self._settle_count()
        # Raises if nothing is left.
        area_without(self.boundary, self._taken)
        self._settle_tag()
        area_without(self.boundary, self.blocked)
        check_plate(self.substrate, self.boundary, self.blocked, self.dot if isinstance(self.dot, float) else None)
        if isinstance(self.poses, str):
            object.__setattr__(self, "poses", named_poses(self.poses).name)
        self._check_relief_and_labels()
        if not 0 <= self.print_sigma < self.boundary.radius:
            raise InputError(
                f"a print error of 0 or more, and below the radius of the {self.boundary}",
                f"print_sigma={self.print_sigma} m",
                "give --print-sigma a length such as 0.1mm",
            )
        self._settle_noise_model()

    def _settle_count(self) -> None:
        if self.target:
            object.__setattr__(self, "target", str(parse_target(self.target)))
            if self.n != AUTO:
                raise InputError("the fewest dots for a target", f"n={self.n}", "leave out --n, or --target")
        if self.n == AUTO and self.relief:
            raise InputError(
                "a number of dots for a relief", f"n=auto, relief={self.relief} m", "give --n a number such as 6"
            )
        if self.n == AUTO and self.dot is None:
            object.__setattr__(self, "dot", "auto")
        check_scale(self.scale_sigma)
        if self.print_sigma is UNSET:
            object.__setattr__(self, "print_sigma", PRINT_SIGMA if self.n == AUTO else 0.0)

    def _check_points(self) -> None:
        if not self.points:
            return
        if self.n != len(self.points):
            raise InputError(
                f"{self.n or 'a search for'} control points",
                f"{len(self.points)} points",
                "leave out --n and --target, or --points",
            )
        if self.dot == "auto":
            raise InputError("a diameter for the dots of given points", "--dot auto", "give a length such as 36mm")
        axes = {len(row) for row in self.points}
        if axes != ({3} if self.relief else {2}):
            wanted = "x, y and z of every dot of a relief" if self.relief else "x and y of every dot"
            remedy = "give --relief for heights" if 3 in axes else "add the heights"
            raise InputError(wanted, f"rows of {' and '.join(map(str, sorted(axes)))} numbers", remedy)

    def _check_relief_and_labels(self) -> None:
        if not (isfinite(self.asymmetric) and self.asymmetric >= 0):
            raise InputError(
                "a safety of labels of 0 px or more",
                f"asymmetric={self.asymmetric} px",
                "use --asymmetric 3, for example",
            )
        if not 0 <= self.relief <= self.boundary.radius:
            raise InputError(
                f"a relief of 0 or more, and no higher than the radius of the {self.boundary}",
                f"relief={self.relief} m",
                "give --relief a length such as 20mm",
            )
        if self.relief and self.asymmetric:
            raise InputError(
                "either a relief or labels from the layout",
                f"relief={self.relief} m and asymmetric={self.asymmetric} px",
                "leave out --asymmetric: a marker with relief has a key ring",
            )

    def _settle_tag(self) -> None:
        if self.tag_side is not None and not self.tag:
            raise InputError("a tag with a tag size", f"tag_side={self.tag_side} m alone", "add --tag, or leave it out")
        if self.tag:
            tag = place_tag(self.tag, self.tag_side, self.boundary, self._taken)
            object.__setattr__(self, "tag", str(tag))
            object.__setattr__(self, "tag_side", tag.side)

    @property
    def placed_tag(self) -> Tag | None:
        """Tag in the middle of the boundary, if there is one."""
        if self.tag_side is None:
            return None
        return place_tag(self.tag, self.tag_side, self.boundary, self._taken)

    @property
    def _taken(self) -> tuple[Boundary, ...]:
        """Regions that the tag must avoid as well."""
        return (*self.keep_outs, *self.substrate.rims)

    @property
    def blocked(self) -> tuple[Boundary, ...]:
        """All regions without dots: keep-outs, the tag with its quiet zone, holes of the plate and its outline."""
        tag = self.placed_tag
        return (*self.keep_outs, *((tag.quiet_zone,) if tag else ()), *self.substrate.rims)

    def _settle_noise_model(self) -> None:
        # Normalized here, so that equivalent specs are equal and have the same hash.
        if not self.noise_model:
            image = self.dot == "auto" or self.n == AUTO or self.print_sigma > 0
            object.__setattr__(self, "noise_model", "image" if image else "point")
        if self.noise_model not in NOISE_MODELS:
            raise InputError("a known noise model", repr(self.noise_model), among(self.noise_model, NOISE_MODELS))
        if self.noise_model == "point" and self.dot == "auto":
            raise InputError(
                "the noise model image for --dot auto",
                "noise_model='point'",
                "leave out --noise-model, or give a --dot",
            )
        if self.noise_model == "point" and self.print_sigma:
            raise InputError(
                "the noise model image for a print error",
                f"print_sigma={self.print_sigma} m with noise_model='point'",
                "use --noise-model image, or leave out --print-sigma",
            )
        if self.noise_model == "image" and self.dot == 0:
            raise InputError(
                "dots with a size for the noise model image", "dot=0", "give --dot a length such as 36mm, or auto"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the spec as plain JSON values, lengths in m; of the noise, only non-default values."""
        # `asdict` would copy deeply, which is slow for the poses of a file.
        values = asdict(replace(self, poses="paper"))
        values["poses"] = self.poses if isinstance(self.poses, str) else self.poses.as_dict()
        values["boundary"] = self.boundary.as_dict()
        values["camera"] = self.camera.as_dict()
        values["points"] = [list(row) for row in self.points]
        # Specs from before there was a noise model keep their hash.
        if self.noise_model == "point":
            del values["noise_model"]
        if self.image_noise == USUAL_IMAGE:
            del values["image_noise"]
        if not self.survive:
            del values["survive"]
        values["keep_outs"] = [keep_out.as_dict() for keep_out in self.keep_outs]
        if not self.keep_outs:
            del values["keep_outs"]
        if not self.tag:
            del values["tag_side"]
        values["substrate"] = self.substrate.as_dict()
        if self.substrate == Substrate():
            del values["substrate"]
        for name in (
            "print_sigma",
            "asymmetric",
            "relief",
            "tag",
            "gap",
            "scale_sigma",
            "camera_covariance",
            "target",
            "points",
        ):
            if not values[name]:
                del values[name]
        return values

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits of the SHA-256 of the canonical JSON of the spec."""
        values = replace(self, poses="paper").as_dict()
        # The name of a file is not part of the request.
        values["poses"] = self.poses if isinstance(self.poses, str) else self.poses.sha256
        text = json.dumps(values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()[:8]


def check_scale(sigma: float) -> None:
    """Refuse a standard deviation of a print's scale that is not 0 to 0.1; raises InputError."""
    if not (isinstance(sigma, Real) and 0 <= sigma <= 0.1):
        raise InputError(
            "a scale error of 0 to 0.1",
            f"scale_sigma={brief(sigma)}",
            "give a fraction: 0.001 is 0.1 %, 1 mm in a meter",
        )


def check_losses(n: int, lost: int) -> None:
    """Refuse to lose `lost` of n dots if too few are left, or if there are too many sets of lost dots."""
    if not 0 <= lost <= MOST_LOST:
        raise InputError(f"0 to {MOST_LOST} lost dots", f"survive={lost}", "give --survive 1, 2 or 3")
    if lost and n - lost < 4:
        raise InputError(
            "four dots or more that are left", f"n={n}, survive={lost}", f"use --n {4 + lost} or more, or lose fewer"
        )
    if comb(n, lost) > MOST_LOSSES:
        raise InputError(
            f"at most {MOST_LOSSES} sets of lost dots",
            f"{comb(n, lost)} for n={n}, survive={lost}",
            "use a smaller --survive or fewer dots",
        )
