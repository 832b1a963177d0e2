"""The result of a calibration: the print as measured, the camera, and how well both are known."""

# tests: tests/calibration/test_loose.py tests/calibration/test_measured_marker.py tests/cli/test_calibrate.py

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from markergen.arrays import Array
from markergen.calibration.adjustment import Adjustment, adjust, attempt
from markergen.calibration.camera_choice import CameraChoice, choose_camera, wider_lenses
from markergen.calibration.flexing import Flex, flexing
from markergen.calibration.judging import (
    CrossValidation,
    Halves,
    NotJudged,
    Photographs,
    compare_halves,
    cross_validate,
)
from markergen.calibration.network import LEAST_DOTS, CameraFreedom, Length, Network, Views, lengths_among
from markergen.calibration.next_photo import NextPhotos, next_photos
from markergen.calibration.photos import PhotographedDots, find_dots, joined_photographs
from markergen.calibration.pictures import stations
from markergen.calibration.relation import Relation, relate
from markergen.calibration.residuals import MISFIT, Cleaned, adjust_robustly, likely_cause, noise_of
from markergen.calibration.scale import ScaleErrors, doubt
from markergen.calibration.weaknesses import explain, findings, rarely_seen, refusal
from markergen.calibration.working_error import ExpectedError, sensitivity
from markergen.defaults import PRINT_SIGMA
from markergen.errors import InputError
from markergen.files import Written, write_all
from markergen.maths.conics import mirrored_poses
from markergen.model.body import Body
from markergen.model.body_json import body_to_json
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.poses import PoseDistribution
from markergen.model.rescale import by_rulers, photographed
from markergen.objectives.base import Setting
from markergen.options import Progress
from markergen.presentation.results import SavableResult, Targets, json_bytes, plain
from markergen.presentation.tables import Table, number
from markergen.read.cameras.files import camera_bytes, check_camera_path
from markergen.validation.setting import setting_of

ANEW = (
    "What was measured of the dots before takes no part, nor does their scale: give lengths between them again "
    "(--measured), and all photographs at once."
)
"""Note to the calibration of a marker that was calibrated before."""


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A camera of a calibration, with a name if there are several.

    The covariance (k, k) of its parameters is None if it was taken as exact, `estimated` empty if it was given, and
    `choice` says which parameters of an unknown one were tried and taken.
    """

    name: str
    camera: Camera
    covariance: Array | None
    estimated: tuple[str, ...]
    choice: CameraChoice | NotJudged | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        sigma = None if self.covariance is None else np.sqrt(np.diag(self.covariance)).tolist()
        named = sigma and dict(zip(self.camera.parameter_names, sigma, strict=True))
        return {**self.camera.as_dict(), "estimated": self.estimated, "sigma": named}


@dataclass(frozen=True, eq=False)
class Calibration(SavableResult):
    """A print measured by photographs, and the camera.

    Attributes
    ----------
    designs : tuple of Marker
        Markers as given.
    markers : tuple of Marker
        Measured markers: dots at their places with the joint covariance, in the frame of the design. As given if their
        geometry was held.
    cameras : tuple of CalibratedCamera
        The camera, or several of which each took its own photographs of the same prints.
    sightings : PhotographedDots
        Dots seen; those of `chosen` are columns of the adjustment.
    chosen : array (k,) of int
        Dots that were adjusted, among those of all markers: those that two photographs or more saw.
    adjustment : Adjustment
        Of the views that are left.
    used : array (v,) of bool
        Views of `sightings` that are left.
    dropped : array (v, k) of bool
        Dots rejected as outliers, in all views.
    before, after : ExpectedError
        Expected pose error with the print as designed and as measured.
    scale_source : str
        What the scale of the print comes from, as a sentence.
    notes : tuple of str
        Warnings, as sentences.
    cross_validation, halves, flex
        What left-out photographs, two halves, and a test for bending say; `NotJudged` where there are too few.
    next_photos : NextPhotos or None
        Which photographs to take next; None if the dots were held.
    cause : str
        What most likely is not as modeled, where residuals are larger than the noise explains; else empty.
    relation : Relation or None
        Of a rig or of several cameras: the rig as measured, how far its markers are from where they were designed, and
        how the cameras are held together.

    Examples
    --------
    See `markergen.calibrate`.

    >>> from markergen.calibration.calibration import Calibration
    >>> Calibration.KINDS[".json"]
    'marker'
    """

    KINDS: ClassVar[Mapping[str, str]] = {
        ".json": "marker",
        **dict.fromkeys((".html", ".htm"), "report"),
        **dict.fromkeys((".yaml", ".yml", ".xml", ".txt"), "camera"),
    }

    designs: tuple[Marker, ...]
    markers: tuple[Marker, ...]
    cameras: tuple[CalibratedCamera, ...]
    sightings: PhotographedDots
    chosen: NDArray[np.intp]
    adjustment: Adjustment
    used: NDArray[np.bool_]
    dropped: NDArray[np.bool_]
    before: ExpectedError
    after: ExpectedError
    scale_source: str
    notes: tuple[str, ...]
    cross_validation: CrossValidation | NotJudged
    halves: Halves | NotJudged
    flex: Flex | NotJudged
    next_photos: NextPhotos | None
    relation: Relation | None = None
    cause: str = ""
    written: tuple[Written, ...] = ()

    @property
    def camera(self) -> Camera:
        """The first camera, as given or as calibrated."""
        return self.cameras[0].camera

    @property
    def camera_covariance(self) -> Array | None:
        """Covariance (k, k) of the first camera's parameters; None if it was taken as exact."""
        return self.cameras[0].covariance

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the first camera's parameters that the photographs determined; empty if it was given."""
        return self.cameras[0].estimated

    @property
    def rig(self) -> Body | None:
        """The rig as measured; None for markers that are no rig's."""
        return None if self.relation is None else self.relation.rig

    def parts(self) -> Sequence[str | Table]:
        """See `Result.parts`."""
        from markergen.calibration.sentences import summary

        return summary(self)

    def __repr__(self) -> str:
        seen, count = len(self.adjustment.views), len(self.chosen)
        return f"<Calibration: {count} dots in {seen} views, RMS {self.adjustment.rms:.3f} px>"

    def save(self, *paths: str | PathLike[str], **named: Any) -> list[Written]:
        """Write the measured markers and the cameras (.yaml, .xml, .txt), each in order, and the report (.html)."""
        targets = self.targets(paths, **named).checked()
        files = len(self.designs) if self.rig is None else 1
        moved = sum(camera.covariance is not None for camera in self.cameras)
        self.check_targets(targets, files, self.measured or self.rig is not None, moved)
        return self.write(targets)

    @property
    def measured(self) -> bool:
        """True if the dots were measured, False if they were held where they were designed."""
        return self.adjustment.network.free

    @property
    def to_use(self) -> bool:
        """Whether the photographs show that what was measured is better than the design."""
        from markergen.calibration.sentences import verdict

        return verdict(self)[1]

    @staticmethod
    def check_targets(targets: Targets, markers: int, measured: bool, cameras: int) -> None:
        """Refuse files for what the calibration does not find.

        Raises
        ------
        InputError
            If there is another number of files than of markers or of `cameras` that are estimated, or one for what was
            held.
        """
        kinds = [kind for kind, _ in targets.files]
        for kind, path in targets.files:
            if kind == "camera":
                check_camera_path(path)
        asked = kinds.count("marker")
        if asked and not measured:
            raise InputError("no marker.json to write with --geometry nominal", "one", "leave it out")
        if asked not in (0, markers):
            raise InputError(f"as many files as markers, {markers}", str(asked), "give an -o ....json for each")
        if cameras and kinds.count("camera") not in (0, cameras):
            actual = str(kinds.count("camera"))
            remedy = "give an -o ....yaml for each, in order; several cameras have a --camera NAME=FILE or NAME= each"
            raise InputError(f"as many files as cameras, {cameras}", actual, remedy)
        if "camera" in kinds and not cameras:
            named = next(path for kind, path in targets.files if kind == "camera")
            raise InputError(
                "no camera to write, since the given one is taken as exact",
                f"-o {named}",
                f"leave out -o {named}, or --camera, or give --camera-covariance",
            )

    def write(self, targets: Targets) -> list[Written]:
        """See `SavableResult.write`."""
        bodies = iter(self.markers if self.rig is None else [self.rig])
        cameras = (camera for camera in self.cameras if camera.covariance is not None)
        contents = {}
        for kind, path in targets.files:
            if kind == "marker":
                contents[path] = body_to_json(next(bodies))
            elif kind == "camera":
                camera = next(cameras)
                contents[path] = camera_bytes(camera.camera, path, camera.covariance, self.adjustment.rms)
            else:
                contents[path] = self.content(kind, path)
        write_all(contents)
        return [Written(path) for path in contents]

    def content(self, kind: str, path: Path) -> bytes:
        """See `SavableResult.content`."""
        if kind == "report":
            from markergen.calibration.report import calibration_page

            return calibration_page(self)
        return super().content(kind, path)

    def to_json(self) -> bytes:
        """See `SavableResult.to_json`; docs/calibrate.md says what is what."""
        return json_bytes(plain(self.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """Return the results as plain JSON values."""
        from markergen.calibration.sentences import unused, verdict

        adjustment, sightings = self.adjustment, self.sightings
        spread = np.sqrt(np.maximum(np.diag(adjustment.covariance), 0)).reshape(-1, 3) if self.measured else None
        numbered = [(k, point.id) for k, marker in enumerate(self.designs) for point in marker.control_points]
        columns, views = adjustment.weights > 0, np.flatnonzero(self.used)
        sentence, use = verdict(self)
        return {
            "verdict": sentence,
            "use": use,
            "rms_px": adjustment.rms,
            "chi2": adjustment.chi2,
            "degrees_of_freedom": adjustment.degrees_of_freedom,
            "variance_factor": adjustment.variance_factor,
            "scale": self.scale_source,
            "expected": {"before": asdict(self.before), "after": asdict(self.after)},
            "camera": self.cameras[0].as_dict(),
            "dots": [
                {
                    "marker": numbered[index][0],
                    "id": numbered[index][1],
                    "place": adjustment.places[column].tolist(),
                    "moved": (adjustment.places[column] - adjustment.network.design[column]).tolist(),
                    "sigma": None if spread is None else spread[column].tolist(),
                    "views": int(columns[:, column].sum()),
                    "rejected": int(self.dropped[:, column].sum()),
                }
                for column, index in enumerate(self.chosen.tolist())
            ],
            "photos": [
                {
                    "photo": sightings.photos[sightings.photo[view]],
                    "marker": int(sightings.marker[view]),
                    "dots": int(columns[row].sum()),
                    "rms_px": float(np.sqrt((adjustment.residual[row][columns[row]] ** 2).sum(axis=-1).mean())),
                    "rejected": [numbered[index][1] for index in self.chosen[self.dropped[view]].tolist()],
                }
                for row, view in enumerate(views.tolist())
            ],
            "unused": dict(unused(self)),
            "left_out": self._left_out(),
            "halves": _judgment(self.halves, "verdict", "rms_um", "chance"),
            "flex": _judgment(self.flex, "verdict", "amplitude", "chance"),
            "cause": self.cause,
            "notes": self.notes,
            **({} if self.rig is None else {"relation": self._relation()}),
            **({"cameras": self._cameras()} if len(self.cameras) > 1 else {}),
        }

    def _cameras(self) -> list[dict[str, Any]]:
        relation, listed = self.relation, []
        assert relation is not None
        for k, (camera, rotation, translation) in enumerate(zip(self.cameras, *relation.cameras, strict=True)):
            pose = {"rotation": rotation.tolist(), "translation": translation.tolist()}
            spread = relation.camera_covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6].tolist()
            place = {f"T_camera_{relation.names[0]}": pose, "pose_covariance": spread}
            listed.append({"name": camera.name, **camera.as_dict(), **place})
        return listed

    def _relation(self) -> dict[str, Any]:
        relation = self.relation
        assert relation is not None
        return {
            "photographs": relation.photographs,
            "looseness": relation.looseness,
            "markers": [
                {
                    "name": plate.name,
                    "T_rig_marker": {"rotation": plate.rotation, "translation": plate.translation},
                    "turned_deg": angle,
                    "moved": distance,
                    "sigma": {"rotation_deg": by_rotation, "translation": by_translation},
                }
                for plate, angle, distance, by_rotation, by_translation in relation.plate_rows()
            ],
        }

    def _left_out(self) -> dict[str, Any]:
        cross = self.cross_validation
        if isinstance(cross, NotJudged):
            return {"reason": cross.reason}
        rms = {"measured_px": cross.measured.rms, "nominal_px": cross.best_nominal.rms}
        gain = cross.gain and {"gain": cross.gain.ratio, "low": cross.gain.low, "high": cross.gain.high}
        return {"verdict": cross.verdict, **rms, **(gain or {}), "better": cross.better}


def _judgment(judgment: Any, *keys: str) -> dict[str, Any]:
    return {key: getattr(judgment, key) for key in (("reason",) if isinstance(judgment, NotJudged) else keys)}


BASE = ("fx", "cx", "cy", "k1", "k2")
"""Parameters of an unknown camera that are always estimated; fy goes with fx."""

LOOSE_PLANE, LOOSE_HEIGHT = 2.0, 10.0
"""Standard deviations of printed dots about the design in the plane and in height, in those of `Known.print_sigma`."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known besides the photographs.

    Covariance (k, k) of the camera's parameters, None if it is exact; whether the dots are `free` or where they were
    designed; measured lengths, dots by their index among those of all markers; the standard deviation in m of a printed
    dot that nothing measures, along each axis; errors of the print's scale; and the working volume, None for that of
    the design.
    """

    camera: Camera | None = None
    covariance: Array | None = None
    free: bool = True
    lengths: tuple[Length, ...] = ()
    print_sigma: float = PRINT_SIGMA
    errors: ScaleErrors = field(default_factory=ScaleErrors)
    poses: str | PoseDistribution | None = None

    def __post_init__(self) -> None:
        if self.free and not self.print_sigma:
            advice = "leave it out, or calibrate the camera by the dots as designed, with --geometry nominal"
            raise InputError("a --print-sigma above 0 for dots to measure", "0", advice)


def network_of(designs: Sequence[Marker], knowledge: Known, camera: Camera, names: Sequence[str]) -> Network:
    """Return the network of all dots of some markers.

    Dots measured by hand, with a sigma, are a prior; `names` are the parameters of an unknown camera to estimate.
    """
    if knowledge.camera is None:
        freedom = CameraFreedom.of_names(camera, names)
    elif knowledge.covariance is None:
        freedom = CameraFreedom.held(camera)
    else:
        freedom = CameraFreedom.of_covariance(knowledge.covariance)
    beside = {"free": knowledge.free, "lengths": knowledge.lengths, "prior": _prior(designs)}
    return Network.of_markers(designs, camera, freedom, **beside)


def _prior(designs: Sequence[Marker]) -> Array | None:
    """Inverse covariances (n, 3, 3) of dots measured by hand; None if there are none."""
    if all(marker.place_covariance is None for marker in designs):
        return None
    blocks = []
    for marker in designs:
        block = np.zeros((len(marker), 3, 3))
        if marker.place_covariance is not None:
            is_measured = np.isfinite(marker.place_covariance).all(axis=(1, 2))
            block[is_measured, :2, :2] = np.linalg.inv(marker.place_covariance[is_measured])
        blocks.append(block)
    return np.concatenate(blocks)


def calibrate_bodies(
    bodies: Sequence[Body],
    photos: Any,
    knowledge: Known | Mapping[str, Known],
    workers: int | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Measure printed markers, and cameras that are unknown, by photographs of them; also what is held together.

    Bodies are markers, or a rig alone; photographs are those of `photos.find_dots`. For several cameras, photographs
    and what is known are mappings by their names; `photos.joined_photographs` decides which are of one moment.

    Raises
    ------
    InputError
        If no photograph can be used, or they do not determine what is asked for.
    """
    by_name, taken = (knowledge, photos) if isinstance(knowledge, Mapping) else ({"": knowledge}, {"": photos})
    first = next(iter(by_name.values()))
    # A print that was calibrated before is measured anew.
    markers = [plate.marker for body in bodies for plate in body.plates]
    designs = [by_rulers(marker) if marker.joint_covariance else marker for marker in markers]
    ruled = first.errors.ruler_lengths(designs, first.lengths)
    options: dict[str, Any] = {"progress": progress, "workers": workers}
    parts, wholes = list[PhotographedDots](), list[Network]()
    for name, by_camera in by_name.items():
        prior, spread = by_camera.camera, by_camera.covariance
        sightings, camera = find_dots(designs, taken[name], prior, camera_covariance=spread, **options)
        reasons = "; ".join(f"{sightings.photos[k]}: {reason}" for k, reason in list(sightings.unused.items())[:3])
        if not len(sightings.views):
            raise InputError("photographs that show the marker", f"none of {len(sightings.photos)}", reasons)
        if by_camera.free and len(sightings.views) < 2:
            raise InputError(
                "two photographs or more that show the marker",
                f"one ({reasons})" if reasons else "one",
                "take ten to forty, tilted by 20 to 60 deg to all sides",
            )
        whole = network_of(designs, by_camera, camera, () if by_camera.camera else BASE)
        parts.append(sightings)
        wholes.append(replace(whole, lengths=(*first.lengths, *ruled)))
    report = progress or (lambda *_: None)
    report("adjusting", 0, 1)
    whole, sightings = wholes[0], parts[0]
    try:
        is_unknown = [by_camera.camera is None for by_camera in by_name.values()]
        fits = [_adjusted(*part) for part in zip(wholes, parts, is_unknown, strict=True)]
        cleaned, sightings, _ = fits[0]
        if len(by_name) > 1:
            sightings = joined_photographs([fit[1] for fit in fits], tuple(by_name))
            whole, cleaned = _together(whole, sightings, [fit[0] for fit in fits])
        is_noisy = any(fit[1] is not part for fit, part in zip(fits, parts, strict=True))
        _ = cleaned.adjustment.unscaled
        off = first.errors.contradictions(designs, cleaned.adjustment, first.print_sigma)
        if any(off):
            first = replace(first, errors=first.errors.widened(designs, off))
            cleaned = _with_lengths(cleaned, (*first.lengths, *first.errors.ruler_lengths(designs, first.lengths)))
        if cleaned.adjustment.degrees_of_freedom > 0:
            cleaned = _held_loosely(cleaned, first.print_sigma, is_noisy)
    except np.linalg.LinAlgError:
        error = refusal(explain(whole, sightings.views, _names(designs)))
        assert error is not None
        raise error from None
    report("adjusting", 1, 1)
    report("judging", 0, 1)
    choices = dict(zip(by_name, zip(is_unknown, [fit[2] for fit in fits], strict=True), strict=True))
    body = _with_markers(bodies[0], designs) if len(bodies[0].plates) > 1 else None
    result = _result(designs, first, sightings, np.flatnonzero(cleaned.dots), cleaned, choices, body, off)
    report("judging", 1, 1)
    anew = [ANEW] if any(marker.joint_covariance for marker in markers) else []
    return replace(result, notes=(*result.notes, *anew))


def _together(whole: Network, sightings: PhotographedDots, fits: Sequence[Cleaned]) -> tuple[Network, Cleaned]:
    """Network of all dots and several cameras, and its adjustment without outliers, from one of each camera."""
    networks = [Photographs.of(fit.adjustment, fit.adjustment.views.camera).network for fit in fits]
    cameras = tuple(network.camera for network in networks)
    whole = replace(whole, cameras=cameras, freedom=CameraFreedom.joined([network.freedom for network in networks]))
    return whole, adjust_robustly(whole, _started(sightings.views, *fits))


def _cameras(
    adjusted: Adjustment, choices: Mapping[str, tuple[bool, CameraChoice | NotJudged | None]]
) -> tuple[CalibratedCamera, ...]:
    """Cameras as adjusted; by their names, `choices` say whether each was unknown, and what was taken then."""
    cameras, network = [], adjusted.network
    directions = network.freedom.directions
    covariance = adjusted.camera_covariance if len(network.freedom) else np.zeros((len(directions),) * 2)
    for k, (name, (is_unknown, choice)) in enumerate(choices.items()):
        rows = network.parameters(k)
        estimated = (choice.names if isinstance(choice, CameraChoice) else BASE) if is_unknown else ()
        spread = covariance[rows, rows] if directions[rows].any() else None
        cameras.append(CalibratedCamera(name, adjusted.cameras[k], spread, estimated, choice))
    return tuple(cameras)


def adjust_loosely(
    marker: Marker, sightings: PhotographedDots, camera: Camera, knowledge: Known
) -> tuple[Cleaned, PhotographedDots, tuple[str, ...]]:
    """Adjust a marker's photographs, with its dots within the errors of its print; return as `_adjusted`, with names.

    Dots that photographs measured before are within the errors of that.
    """
    loose = (LOOSE_PLANE * knowledge.print_sigma, LOOSE_HEIGHT * knowledge.print_sigma)
    if marker.joint_covariance:
        variances = np.diag(np.array(marker.joint_covariance.matrix)).reshape(-1, len(marker.joint_covariance.axes))
        loose = float(np.sqrt(variances[:, :2].mean())), float(np.sqrt(variances[:, -1].mean()))
    names = () if knowledge.camera else BASE
    network = replace(network_of([marker], knowledge, camera, names), loose=loose)
    cleaned, sightings, choice = _adjusted(network, sightings, not knowledge.camera)
    return cleaned, sightings, choice.names if isinstance(choice, CameraChoice) else names


def _adjusted(
    network: Network, sightings: PhotographedDots, choose: bool
) -> tuple[Cleaned, PhotographedDots, CameraChoice | NotJudged | None]:
    """Adjust without outliers; return also the sightings with the noise that they show, and the camera's parameters.

    If asked to `choose`, as many parameters of the camera are taken as the photographs need.

    Raises
    ------
    UndeterminedError
        If the photographs do not determine the unknowns.
    """
    cleaned = _unflipped(network, sightings.views)
    noisy = _with_noise(network, sightings, cleaned)
    if noisy is not sightings:
        cleaned = adjust_robustly(network, _started(noisy.views, cleaned))
    choice = None
    if choose:
        adjusted, photo = cleaned.adjustment, noisy.photo[cleaned.used]
        choice = choose_camera(adjusted.network, adjusted.views, photo, adjusted.weights)
        if isinstance(choice, CameraChoice) and choice.names != BASE:
            network = replace(network, cameras=(choice.camera,), freedom=choice.freedom)
            cleaned = adjust_robustly(network, noisy.views)
    return cleaned, noisy, choice


def _with_markers(body: Body, markers: Sequence[Marker], relation: Array | None = None) -> Body:
    plates = [replace(plate, marker=marker) for plate, marker in zip(body.plates, markers, strict=True)]
    return body.with_plates(plates, relation)


def _with_lengths(cleaned: Cleaned, lengths: tuple[Length, ...]) -> Cleaned:
    """Adjust again with other lengths, of all dots, if there are any."""
    adjusted, rulers = cleaned.adjustment, lengths_among(lengths, cleaned.dots)
    if not rulers:
        return cleaned
    network = replace(adjusted.network, lengths=rulers)
    return replace(cleaned, adjustment=adjust(network, adjusted.views, adjusted.weights, adjusted.places))


def _with_noise(network: Network, sightings: PhotographedDots, cleaned: Cleaned) -> PhotographedDots:
    """Sightings with the noise that the photographs show; where one shows none by itself, the median of the others."""
    views, photo = _started(sightings.views, cleaned), sightings.photo
    try:
        flexible = adjust_robustly(wider_lenses(replace(network, free=True))[-1][1], views)
        variance = noise_of(flexible.adjustment, photo[flexible.used])
    except np.linalg.LinAlgError:
        return sightings
    if not variance.any():
        return sightings
    of_photo = dict(zip(photo[flexible.used].tolist(), variance.tolist(), strict=True))
    added = np.array([of_photo.get(number, float(np.median(variance))) for number in photo.tolist()])
    covariance = sightings.views.covariance + added[:, None, None, None] * np.eye(2)
    return replace(sightings, views=replace(sightings.views, covariance=covariance))


def _started(views: Views, *fits: Cleaned) -> Views:
    """Views that start at the poses of an adjustment, or of several of one camera each."""
    start = replace(views, rotation=views.rotation.copy(), translation=views.translation.copy())
    used = np.concatenate([fit.used for fit in fits])
    for name in ("rotation", "translation"):
        getattr(start, name)[used] = np.concatenate([getattr(fit.adjustment.views, name) for fit in fits])
    return start


def _held_loosely(cleaned: Cleaned, print_sigma: float, noisy: bool) -> Cleaned:
    """Where residuals are larger than claimed, adjust again with the weak knowledge that a print is about as designed.

    The image counts with its errors as they were found. It keeps dots that few photographs show from taking up the
    errors of a poor camera.
    """
    from scipy.special import chdtrc

    adjusted = cleaned.adjustment
    is_as_claimed = not noisy and chdtrc(adjusted.degrees_of_freedom, adjusted.chi2) > MISFIT
    if not adjusted.network.free or is_as_claimed:
        return cleaned
    sigma = print_sigma / np.sqrt(adjusted.scale)
    network = replace(adjusted.network, loose=(LOOSE_PLANE * sigma, LOOSE_HEIGHT * sigma))
    return replace(cleaned, adjustment=adjust(network, adjusted.views, adjusted.weights, adjusted.places))


def _result(
    designs: Sequence[Marker],
    knowledge: Known,
    sightings: PhotographedDots,
    chosen: NDArray[np.intp],
    cleaned: Cleaned,
    choices: Mapping[str, tuple[bool, CameraChoice | NotJudged | None]],
    body: Body | None,
    offsets: tuple[float, ...],
) -> Calibration:
    adjustment, photo = cleaned.adjustment, sightings.photo[cleaned.used]
    # What is from one place, or one moment, is left out together.
    first_of = stations(adjustment.views, photo)
    station = sightings.moments[[first_of.get(number, number) for number in photo.tolist()]]
    cross, halves, flex = cross_validate(adjustment, station), compare_halves(adjustment, station), flexing(adjustment)
    cause = likely_cause(adjustment, flex)
    names_of = _names(designs)
    working = _setting(designs, knowledge, adjustment).poses
    poses = working.rotation, working.translation
    weaknesses = [
        weakness
        for k in range(len(choices) if knowledge.free else 0)
        for weakness in findings(adjustment.led_by(k), knowledge.print_sigma, poses, [names_of[k] for k in chosen])
    ]
    if (error := refusal(weaknesses, cause)) is not None:
        raise error
    relation, source, first = None, adjustment, int(adjustment.network.marker[0])
    if body is not None or len(choices) > 1:
        moment, names = sightings.moments[photo], [sightings.photos[k] for k in photo]
        relation = relate(body, adjustment, moment, knowledge.print_sigma, tuple(choices), names)
        relation = replace(relation, scale_sigma=knowledge.errors.left(designs[first], adjustment.network, first))
        # Photographs of one moment tell of the cameras, too, unless they were not taken at once.
        source = relation.together if len(choices) > 1 and not relation.warnings else adjustment
    cameras = _cameras(source, choices)
    counts = sightings.views.seen.sum(axis=0)
    lost = np.setdiff1d(np.arange(len(names_of)), chosen)
    rare = rarely_seen(counts[lost], [names_of[k] for k in lost]) if knowledge.free else ()
    notes = list(dict.fromkeys(str(weakness) for weakness in (*weaknesses, *rare)))
    notes += [flex.verdict] if isinstance(flex, Flex) and flex.bends else []
    if cause:
        notes.append(
            "the residuals are larger than the noise of the photographs, chi2 "
            f"{number(adjustment.variance_factor)} per degree of freedom; most likely {cause}"
        )
    notes += [*sightings.doubts, *sightings.notes]
    for camera in cameras:
        of_camera = f"camera {camera.name}: " * bool(camera.name)
        if isinstance(camera.choice, CameraChoice):
            notes += [f"{of_camera}{note}" for note in camera.choice.notes]
        elif camera.choice is not None:
            notes.append(f"{of_camera}which parameters the camera needs was not judged: {camera.choice.reason}")
    markers = tuple(designs)
    if knowledge.free:
        # With one pose for all markers of a photograph, the dots are known better.
        together = source if relation is None or relation.rig is None else relation.together
        dots = together.places, together.covariance
        photos = len(sightings.photos)
        # A rig grows as a whole, of which its markers' dots cannot tell.
        errors, network = knowledge.errors, adjustment.network
        left = [
            0.0 if relation and relation.rig else errors.left(design, network, k) for k, design in enumerate(designs)
        ]
        markers = tuple(_measured(designs, k, chosen, adjustment, photos, left[k], *dots) for k in range(len(designs)))
        # What is to be said of the first marker's rulers is said where its scale is.
        notes += [doubt(off_by) for k, off_by in enumerate(offsets) if off_by and k != network.marker[0]]
    if relation is not None:
        notes += relation.warnings
        if relation.rig is not None:
            relation = replace(relation, rig=_with_markers(relation.rig, markers, relation.rig.relation_covariance))
    return Calibration(
        tuple(designs),
        markers,
        cameras,
        sightings,
        chosen,
        adjustment,
        cleaned.used,
        cleaned.dropped[:, chosen],
        *_expected(designs, knowledge, adjustment),
        knowledge.errors.source(designs[first], adjustment.network, offsets[first]),
        tuple(note[:1].upper() + note[1:].rstrip(".") + "." for note in notes),
        cross,
        halves,
        flex,
        next_photos(adjustment, poses, [names_of[k] for k in chosen]) if knowledge.free else None,
        relation,
        cause,
    )


def _names(designs: Sequence[Marker]) -> list[str]:
    """Names of all dots, for sentences."""
    if len(designs) == 1:
        return [f"dot {point.id}" for point in designs[0].control_points]
    return [f"dot {p.id} of marker {k + 1}" for k, marker in enumerate(designs) for p in marker.control_points]


def _unflipped(network: Network, views: Views) -> Cleaned:
    """Adjust, and again if a view fits better with its mirrored pose: from afar a flat marker has two."""
    cleaned = adjust_robustly(network, views)
    adjusted, dots = cleaned.adjustment, cleaned.dots
    held = adjusted.network.held(adjusted.places, adjusted.cameras)
    start, changed = _started(views, cleaned), False
    for k in range(len(views)):
        seen = views.seen[k] & dots & ~cleaned.dropped[k]
        view = start.take(slice(k, k + 1)).of_dots(seen)
        if seen.sum() < LEAST_DOTS:
            continue
        fits = []
        mirrored = mirrored_poses(adjusted.places[seen[dots]], view.rotation, view.translation)
        for rotation, translation in ((view.rotation, view.translation), mirrored):
            fit = attempt(held.of_dots(seen[dots]), replace(view, rotation=rotation, translation=translation))
            fits += [fit] if fit else []
        if len(fits) == 2 and fits[1].chi2 < 0.8 * fits[0].chi2:
            other = fits[1].views
            if np.trace(fits[0].views.rotation[0].T @ other.rotation[0]) < 2.999:
                start.rotation[k], start.translation[k], changed = other.rotation[0], other.translation[0], True
    return adjust_robustly(network, start) if changed else cleaned


def _measured(
    designs: Sequence[Marker],
    which: int,
    chosen: NDArray[np.intp],
    adjustment: Adjustment,
    photos: int,
    left: float,
    places: Array,
    covariance: Array,
) -> Marker:
    """Return a marker with its adjusted dots where they are in the print; `left` is what is unknown of its scale."""
    is_on_marker = adjustment.network.marker == which
    if is_on_marker.sum() < 2:
        return designs[which]
    before = sum(len(design) for design in designs[:which])
    ids = [designs[which].control_points[int(index) - before].id for index in chosen[is_on_marker]]
    rows = np.repeat(is_on_marker, 3)
    record = {
        "photographs": photos,
        "views": int(adjustment.views.seen[:, is_on_marker].any(axis=1).sum()),
        "rms_px": adjustment.rms,
        "variance_factor": adjustment.variance_factor,
    }
    grown = left * (places[is_on_marker] - places[is_on_marker].mean(axis=0)).ravel()
    return photographed(
        designs[which], ids, places[is_on_marker], covariance[np.ix_(rows, rows)] + np.outer(grown, grown), record
    )


def _expected(
    designs: Sequence[Marker], knowledge: Known, adjustment: Adjustment
) -> tuple[ExpectedError, ExpectedError]:
    """Expected error of the first marker's pose with the print as designed and as measured."""
    network = adjustment.network
    is_on_marker = network.marker == network.marker[0]
    setting = _setting(designs, knowledge, adjustment)
    poses, camera = setting.poses, adjustment.camera
    # As precise in the image as the photographs themselves.
    noise = float(np.sqrt(adjustment.scale * adjustment.image_variance))
    n, size = int(is_on_marker.sum()), 3 * int(is_on_marker.sum())
    flat = np.kron(np.eye(n), np.diag([knowledge.print_sigma**2, knowledge.print_sigma**2, 0.0]))
    joint = adjustment.joint
    parameters = np.arange(len(network.freedom.directions)) < len(camera.parameter_names)
    rows = np.concatenate([np.repeat(is_on_marker, 3)[: adjustment.normal.dots], parameters])
    joint = joint[np.ix_(rows, rows)]
    if not network.free:
        joint = block_diag(flat, joint)
    # A camera that was unknown is the same before and after: only the print differs.
    lens = joint[size:, size:] if knowledge.covariance is None else knowledge.covariance
    if setting.camera is not camera:
        # Another camera works: exact, as far as is known.
        lens = np.zeros((len(setting.camera.parameter_names),) * 2)
        joint = block_diag(joint[:size, :size], lens)
    errors = []
    cases = (
        (block_diag(flat, lens), network.design[is_on_marker], False),
        (joint, adjustment.places[is_on_marker], network.free),
    )
    for covariance, places, measured in cases:
        # A wrong scale moves all dots together, so weights ignore it.
        growth = (places - places.mean(axis=0)).ravel()
        kept = np.eye(size) - measured * np.outer(growth, growth) / (growth @ growth)
        blocks = (kept @ covariance[:size, :size] @ kept).reshape(n, 3, n, 3)[range(n), :, range(n)]
        working = sensitivity(places, setting.camera, poses.rotation, poses.translation, noise, blocks)
        moved = np.zeros((len(covariance), 2))
        moved[:size] = knowledge.errors.displacements(designs[network.marker[0]], network, places, measured)
        errors.append(working.expected(covariance + moved @ moved.T))
    return errors[0], errors[1]


def _setting(designs: Sequence[Marker], knowledge: Known, adjustment: Adjustment) -> Setting:
    """Working volume of the first marker, with the camera of the photographs if that sees it.

    If the poses are not given, and no pose of the design sees the marker, it is at the distances of the photographs.
    """
    marker = designs[adjustment.network.marker[0]]
    with suppress(InputError):
        return setting_of(marker, knowledge.poses, adjustment.camera)
    if knowledge.poses is not None:
        return setting_of(marker, knowledge.poses)
    with suppress(InputError):
        return setting_of(marker)
    distance = np.linalg.norm(adjustment.views.translation, axis=1)
    around = f"cone:tilt=0..60,distance={distance.min():.6g}..{distance.max():.6g}m"
    return setting_of(marker, around, adjustment.camera)
