"""What detection returns: labeled dots with their pose, or the reason why there are none."""
# tests: tests/detect/test_detection.py tests/detect/test_detector.py

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from markergen_detect import Finding, Second, Verdict
from numpy.typing import NDArray

from markergen.arrays import Array
from markergen.bounds.dot_covariances import image_jacobian
from markergen.detect.presentation import draw, transform_as_dict
from markergen.estimators.budget import PoseBudget
from markergen.estimators.weighted_pose import PoseEstimate
from markergen.maths.reliability import RISK
from markergen.maths.rotation import logarithm
from markergen.model.camera import Camera
from markergen.model.planned_error import amount
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Target
from markergen.presentation.tables import Table

MOST_UNCHECKED = 5
"""Number of dots from which on residuals show which one is wrong: of four, all have the same statistic."""

_WITHOUT_LABELS = ("ambiguous", "claimed", "hidden tag")
"""States in which the dots are those of the marker, and only which is which is open."""


class SecondPose(Second):
    """Second pose T_camera_marker that fits a flat marker, with its likelihood relative to the first.

    Attributes
    ----------
    rotation, translation : arrays (3, 3) and (3,), m
    likelihood_ratio : float
        Likelihood ratio of this pose to the first one, 0 to 1.
    """

    __slots__ = ()

    @property
    def rvec(self) -> Array:
        """Rotation vector (3, 1), rad, in OpenCV's form."""
        return logarithm(self.rotation)[:, None]

    @property
    def tvec(self) -> Array:
        """Translation (3, 1), m, in OpenCV's form."""
        return self.translation[:, None]


@dataclass(frozen=True, eq=False, repr=False)
class Found:
    """The result for one marker in one frame.

    If labels are ambiguous, `pixels` still has the dots, and `ids` is empty. Without a pose (there is no camera, or the
    marker was not found), everything that depends on it is None.

    Attributes
    ----------
    finding : markergen_detect.Finding
        Complete result of the compiled call.
    markers : tuple of Marker or Rig
        Markers and rigs that were looked for.
    names : tuple of str
        Names of the markers: their files, where they came from one.
    camera : Camera or None
    print_sigma : float
        Standard deviation in m of a dot's printed place along each axis.

    Examples
    --------
    >>> import numpy as np
    >>> from markergen.detect import Detector
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.camera import PAPER_CAMERA
    >>> from markergen.model.marker import build_marker
    >>> from markergen.render import Optics, render_view
    >>> kite = np.array([[0.03, 0.03], [-0.03, 0.03], [-0.02, -0.03], [0.03, -0.01]])
    >>> marker = build_marker(kite, Circle(0.06), diameter=0.02, clearance=0.002)
    >>> pose = np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 0.5])
    >>> (found,) = Detector(marker, PAPER_CAMERA)(
    ...     render_view(marker, PAPER_CAMERA, *pose, Optics(), np.random.default_rng(0))
    ... )
    >>> found.ids, found.tag_state, bool(np.allclose(found.translation, pose[1], atol=1e-3))
    (array([0, 1, 2, 3]), 'none', True)
    """

    finding: Finding = field(repr=False)
    markers: tuple[Target, ...]
    names: tuple[str, ...]
    camera: Camera | None
    print_sigma: float = 0.0

    @property
    def ok(self) -> bool:
        """True if four or more control points were found, with unique labels."""
        return self.finding.ok

    @property
    def reason(self) -> str:
        """Reason why the marker was not found; empty otherwise."""
        if self.rival is not None:
            return f"{self.finding.reason}: {self.name} and {self.names[self.rival]}"
        if self.finding.state == "ambiguous" and len(self.turns):
            return f"{self.finding.reason}: this layout repeats under {_degrees(self.turns)}"
        return self.finding.reason

    @property
    def rival(self) -> int | None:
        """Index of another marker that fits the same dots, if that is the reason."""
        rival: int | None = self.finding.facts.get("rival")
        return rival

    @property
    def index(self) -> int:
        """Index of the marker among those that were looked for."""
        return self.finding.body

    @property
    def marker(self) -> Target:
        """The marker or rig itself."""
        return self.markers[self.index]

    @property
    def name(self) -> str:
        """Name of the marker."""
        return self.names[self.index]

    @property
    def ids(self) -> NDArray[np.intp]:
        """Ids (k,) of the control points found; empty if labels are ambiguous.

        For a rig, they are the numbers of the control points through all its markers, in the order of `Rig.xyz`;
        `Rig.dots` has the name of each one's marker, and its id there.
        """
        return self.finding.ids

    @property
    def guess(self) -> NDArray[np.intp]:
        """Ids (k,) for `pixels`; if labels are ambiguous, by one of the labelings that fit."""
        return self.finding.guess[: self._count]

    @cached_property
    def xyz(self) -> Array:
        """Control points (k, 3) for `ids`, m, frame of the marker or rig."""
        row = {number: i for i, number in enumerate(self.marker.ids.tolist())}
        return self.marker.xyz[[row[int(i)] for i in self.ids]]

    @property
    def pixels(self) -> Array:
        """Images (k, 2) of the control points in the frame as taken, px; pixel centers at integer coordinates.

        If labels are ambiguous, these are all dots of the best labeling, in no particular order. Labelings that fit
        equally well predict the same outlines, so that the correction for perspective is nearly the same.
        """
        return self.finding.pixels[: self._count]

    @property
    def pixel_covariance(self) -> Array:
        """Covariance (k, 2, 2) of `pixels` from the image's noise, px^2."""
        return self.finding.pixel_covariance[: self._count]

    @property
    def ellipse_centers(self) -> Array:
        """Centers (k, 2) of the dots' images, px, from which `pixels` were corrected for perspective."""
        return self.finding.ellipse_centers[: self._count]

    @property
    def _count(self) -> int:
        labeled = self.finding.ok or self.finding.state in _WITHOUT_LABELS
        return len(self.finding.pixels) if labeled else 0

    @cached_property
    def pose(self) -> PoseEstimate | None:
        """Pose with its error budget, chi2 and the second solution."""
        finding = self.finding
        if not finding.ok or finding.rotation is None or finding.translation is None:
            return None
        parts = finding.image_covariance, finding.print_covariance, finding.camera_covariance, finding.covariance
        estimate = finding.rotation, finding.translation, PoseBudget(*map(np.asarray, parts))
        quality = finding.chi2, finding.degrees_of_freedom, finding.scale
        if finding.second is None:
            return PoseEstimate(*estimate, *quality)
        rotation, translation, ratio = finding.second
        return PoseEstimate(*estimate, *quality, (rotation, translation), ratio)

    @property
    def rotation(self) -> Array | None:
        """Rotation matrix (3, 3) of T_camera_marker: X_camera = R X_marker + t."""
        return None if self.pose is None else self.pose.rotation

    @property
    def translation(self) -> Array | None:
        """Translation (3,) of T_camera_marker, m."""
        return None if self.pose is None else self.pose.translation

    @property
    def rvec(self) -> Array | None:
        """Rotation vector (3, 1), rad, as cv2.solvePnP returns it."""
        return None if self.pose is None else logarithm(self.pose.rotation)[:, None]

    @property
    def tvec(self) -> Array | None:
        """Translation (3, 1), m, as cv2.solvePnP returns it."""
        return None if self.pose is None else self.pose.translation[:, None]

    @property
    def covariance(self) -> Array | None:
        """Covariance (6, 6) of the pose from image, print and calibration, of (w, dt) in rad and m.

        w and dt are a small rotation and a translation in the camera frame: R <- exp([w]x) R, from the left, and
        t <- t + dt. This is not the covariance of `rvec`. `pose.budget` has the three parts.
        """
        return None if self.pose is None else self.pose.budget.total

    @property
    def second(self) -> SecondPose | None:
        """Other pose from which a flat marker looks much the same, if it is likely enough."""
        if self.pose is None or self.pose.alternative is None:
            return None
        return SecondPose(*self.pose.alternative, self.pose.likelihood_ratio)

    @property
    def homography(self) -> Array | None:
        """H (3, 3) from the marker's plane, m, to px of a camera without distortion; None for a marker with relief."""
        return self.finding.homography if self.ok else None

    @property
    def tag(self) -> Array | None:
        """Corners (4, 2) of the marker's tag, px, in the order of `Tag.corners`; None if none was read."""
        return self.finding.tag_corners if self.ok else None

    @property
    def tag_state(self) -> str:
        """What became of the marker's tag: ``read``, ``other``, ``not read``, or ``none`` for a marker without one."""
        if self.finding.state == "other tag":
            return "other"
        return self.finding.tag_state if self.finding.tag_state in ("read", "none") else "not read"

    @property
    def verdict(self) -> Verdict | None:
        """Whether image, print and camera agree, with likely causes if they do not; None without a pose."""
        return self.finding.verdict if self.ok else None

    @cached_property
    def blunder_statistics(self) -> Array | None:
        """Test statistics (k,) of the dots for `ids`; None without a pose (Baarda 1968).

        v' Q^-1 v, with v the residual of a dot and Q its covariance from image and print: of a dot that is right, it
        has a chi-square distribution with two degrees of freedom.
        """
        if self.pose is None or self.camera is None or len(self.ids) < MOST_UNCHECKED:
            return None
        poses = PoseDistribution("found", self.pose.rotation[None], self.pose.translation[None])
        jacobian = image_jacobian(self.xyz, self.camera, poses)[0]
        # A print is off in its plane, in the body's frame any.
        slopes = jacobian[..., 3:] @ self.pose.rotation[:, : 2 if self.marker.frame == "marker" else 3]
        spread = self.pixel_covariance + self.print_sigma**2 * slopes @ slopes.swapaxes(-1, -2)
        normal = np.sum(jacobian.swapaxes(-1, -2) @ np.linalg.solve(spread, jacobian), axis=0)
        residual = self.pixels - self.camera.project(self.xyz, poses.rotation, poses.translation)[0]
        cofactor = spread - jacobian @ np.linalg.inv(normal) @ jacobian.swapaxes(-1, -2)
        return np.asarray(np.einsum("ki,kij,kj->k", residual, np.linalg.pinv(cofactor), residual))

    @property
    def suspect(self) -> int | None:
        """Id of the dot that is most likely wrong: one right dot in a thousand has such a statistic; None if none has.

        A wrong dot raises the statistics of others, too, but less.
        """
        statistics = self.blunder_statistics
        if statistics is None or statistics.max() <= -2 * np.log(RISK):
            return None
        return int(self.ids[statistics.argmax()])

    @property
    def turns(self) -> Array:
        """Angles (k,), 0 to 2 pi, by which other labelings that are about as likely turn about the marker's normal."""
        return np.sort(np.mod(self.finding.turns, 2 * np.pi))

    def draw(self, frame: NDArray[Any]) -> NDArray[Any]:
        """Draw the outline, the dots with their ids and the axes into a frame, and return it.

        A color frame is modified in place, as by OpenCV's functions; for a grey frame, a BGR copy is returned. Without
        a pose there are no axes; dots with ambiguous labels are marked by crosses only.

        Parameters
        ----------
        frame : array (h, w, 3) BGR or (h, w, 4) BGRA, or grey (h, w) or (h, w, 1), of uint8 or uint16

        Raises
        ------
        InputError
            If the frame has another form, or is in color and read-only.
        """
        return draw(frame, self)

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain JSON values, as ``markergen detect --json`` writes them (docs/detect.md)."""
        target, pose, verdict, ids = self.marker, self.pose, self.verdict, self.ids.tolist()
        tag = target.plates[0].marker.tag if target.frame == "marker" else None
        return {
            "marker": self.name,
            "found": self.ok,
            "reason": self.reason,
            "ids": ids,
            **({"dots": [list(target.dots[number]) for number in ids]} if target.frame == "rig" else {}),
            "missing": sorted(set(target.ids.tolist()) - set(ids)),
            "pixels": self.pixels.tolist(),
            "covariance_px2": self.pixel_covariance.tolist(),
            "ellipse_centers": self.ellipse_centers.tolist(),
            "homography": None if self.homography is None else self.homography.tolist(),
            "lens_bend_px": self.finding.bend,
            "pose": pose and _pose_as_dict(pose),
            "tag": None
            if self.tag is None or tag is None
            else {"family": tag.family, "id": tag.id, "corners": self.tag.tolist()},
            "tag_state": self.finding.tag_state,
            "verdict": verdict and {**verdict._asdict(), "causes": [cause._asdict() for cause in verdict.causes]},
            "turns_deg": np.rad2deg(self.turns).tolist(),
            "suspect": self.suspect,
        }

    def __str__(self) -> str:
        """One line: the marker, and its dots found or the reason; for a pose its distance, tilt and sigma."""
        if not self.ok:
            return f"{self.name} not found: {self.reason}"
        target, pose, verdict = self.marker, self.pose, self.verdict
        line = f"{self.name}, {len(self.ids)} of {len(target)} dots{_UNREAD.get(self.finding.tag_state, '')}"
        if target.frame == "rig":
            line += f" on {len(set(target.owner[self.ids].tolist()))} of {len(target.plates)} markers"
        if len(self.turns):
            line += f", or turned by {_degrees(self.turns)}"
        if pose is None:
            bent = f", {self.finding.bend:.1f} px off since the lens bends it" if self.finding.bend else ""
            return f"{line}, homography only{bent}"
        toward = -pose.rotation.T @ pose.translation
        distance = float(np.linalg.norm(toward))
        line += f", {distance:.4f} m away"
        if target.frame == "marker":
            line += f", tilted by {np.rad2deg(np.arccos(np.clip(toward[2] / distance, -1, 1))):.2f} deg"
        line += f"; 1 sigma: {_sigma(pose)}"
        if pose.alternative is not None:
            line += f"; the mirrored pose fits as well, likelihood ratio {pose.likelihood_ratio:.2g}"
        line += "" if self.suspect is None else f"; dot {self.suspect} is suspect"
        return line if verdict is None or verdict.consistent else f"{line}; {verdict}"

    def __repr__(self) -> str:
        return f"<Found: {self}>"

    def _repr_html_(self) -> str:
        rows = [["found", f"{len(self.ids)} of {len(self.marker)} dots" if self.ok else self.reason]]
        if self.pose is not None:
            rows += [
                ["translation", f"{np.array2string(self.pose.translation, precision=5)} m"],
                ["rotation vector", f"{np.array2string(logarithm(self.pose.rotation), precision=5)} rad"],
                ["1 sigma", _sigma(self.pose)],
            ]
        return Table("", ["marker", self.name], rows).html()


def lines_of(results: Sequence[Found]) -> list[str]:
    """Return a line for each result; one with the names of several markers that were not found, where another was."""
    unseen = [result.name for result in results if not result.ok]
    if len(unseen) < 2 or len(unseen) == len(results):
        return list(map(str, results))
    return [*(str(result) for result in results if result.ok), f"not found: {', '.join(unseen)}"]


_UNREAD = {
    "small": ", its tag too small to be read",
    "outside": ", its tag outside the image",
    "faint": ", its tag too faint to be read",
    "covered": ", its tag covered",
    "unclear": ", its tag unclear",
}
"""Words for the states of a tag that was not read."""


def _degrees(angles: Array) -> str:
    return " or ".join(f"{angle:.0f}" for angle in np.rad2deg(angles)) + " deg"


def _sigma(pose: PoseEstimate) -> str:
    rotation, translation = pose.budget.rotation_deg["total"], 1e3 * pose.budget.translation["total"]
    return f"{amount(float(rotation))} deg, {amount(float(translation))} mm"


def _pose_as_dict(pose: PoseEstimate) -> dict[str, Any]:
    budget, second = pose.budget, pose.alternative
    return {
        **transform_as_dict(pose.rotation, pose.translation),
        "covariance": budget.total.tolist(),
        "sigma": {
            kind: {name: float(part) for name, part in getattr(budget, kind).items()}
            for kind in ("rotation_deg", "translation")
        },
        "chi2": pose.chi2,
        "degrees_of_freedom": pose.degrees_of_freedom,
        "alternative": second and {**transform_as_dict(*second), "likelihood_ratio": pose.likelihood_ratio},
    }
