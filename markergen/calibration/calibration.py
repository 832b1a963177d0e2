"""The result of a calibration: the print as measured, the camera, and how well both are known."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from markergen.calibration.adjustment import Adjustment
from markergen.calibration.camera_choice import CameraChoice
from markergen.calibration.flexing import Flex
from markergen.calibration.judging import CrossValidation, Halves, NotJudged
from markergen.calibration.next_photo import NextPhotos
from markergen.calibration.relation import Relation
from markergen.calibration.sightings import Sightings
from markergen.calibration.working_error import ExpectedError
from markergen.errors import InputError
from markergen.files import Written, write_all
from markergen.model.camera import Camera
from markergen.model.marker import Marker
from markergen.model.rig_json import body_to_json
from markergen.presentation.results import SavableResult, Targets, json_bytes, plain
from markergen.presentation.tables import Table
from markergen.read.cameras.writing import camera_bytes, check_camera_path

Array = NDArray[np.float64]


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
    camera : Camera
        Camera as given, or as calibrated.
    camera_covariance : array (k, k) or None
        Covariance of its parameters; None if it was taken as exact.
    estimated : tuple of str
        Names of the camera parameters that the photographs determined; empty if it was given.
    sightings : Sightings
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
    relation : Relation or None
        Of a rig: the rig as measured, and how far its markers are from where they were designed.
    camera_choice : CameraChoice, NotJudged or None
        Which parameters of an unknown camera were tried and taken; None if the camera was given.

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
    camera: Camera
    camera_covariance: Array | None
    estimated: tuple[str, ...]
    sightings: Sightings
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
    camera_choice: CameraChoice | NotJudged | None
    next_photos: NextPhotos | None
    relation: Relation | None = None
    written: tuple[Written, ...] = ()

    def parts(self) -> list[str | Table]:
        """See `Result.parts`."""
        from markergen.calibration.words import summary

        return summary(self)

    def __repr__(self) -> str:
        seen, count = len(self.adjustment.views), len(self.chosen)
        return f"<Calibration: {count} dots in {seen} views, RMS {self.adjustment.rms:.3f} px>"

    def save(self, *paths: str | PathLike[str], **named: Any) -> list[Written]:
        """Write the measured markers in order (.json), the camera (.yaml, .xml, .txt) and the report (.html)."""
        targets = self.targets(paths, **named).checked()
        files = len(self.designs) if self.relation is None else 1
        found = self.measured or self.relation is not None
        self.check_targets(targets, files, found, bool(self.camera_covariance is not None))
        return self.write(targets)

    @property
    def measured(self) -> bool:
        """True if the dots were measured, False if they were held where they were designed."""
        return self.adjustment.network.free

    @property
    def to_use(self) -> bool:
        """Whether the photographs show that what was measured is better than the design."""
        from markergen.calibration.words import verdict

        return verdict(self)[1]

    def closing(self, shown: bool = False) -> str:
        """See `words.closing`."""
        from markergen.calibration.words import closing

        return closing(self, shown)

    @staticmethod
    def check_targets(targets: Targets, markers: int, measured: bool, camera: bool) -> None:
        """Refuse files for what the calibration does not find.

        Raises
        ------
        InputError
            If there is another number of files than of markers, or one for markers or a camera that were held.
        """
        kinds = [kind for kind, _ in targets.files]
        for kind, path in targets.files:
            if kind == "camera":
                check_camera_path(path)
        asked = kinds.count("marker")
        if asked and not measured:
            raise InputError("no marker.json to write with --geometry nominal", "one", "leave it out")
        if asked not in (0, markers):
            raise InputError(f"{markers} files for {markers} markers", str(asked), "give an -o ....json for each")
        if "camera" in kinds and not camera:
            named = next(path for kind, path in targets.files if kind == "camera")
            raise InputError(
                "no camera to write, since the given one is taken as exact",
                f"-o {named}",
                f"leave out -o {named}, or --camera, or give --camera-covariance",
            )

    def write(self, targets: Targets) -> list[Written]:
        """See `SavableResult.write`."""
        bodies = iter(self.markers if self.relation is None else [self.relation.rig])
        contents = {
            path: body_to_json(next(bodies)) if kind == "marker" else self.content(kind, path)
            for kind, path in targets.files
        }
        write_all(contents)
        return [Written(path) for path in contents]

    def content(self, kind: str, path: Path) -> bytes:
        """See `SavableResult.content`."""
        if kind == "report":
            from markergen.calibration.report import page

            return page(self)
        if kind == "camera":
            return camera_bytes(self.camera, path, self.camera_covariance, self.adjustment.rms)
        return super().content(kind, path)

    def saved(self, targets: Targets) -> "Calibration":
        """Write targets that were checked before, and return the result with what was written."""
        return replace(self, written=tuple(self.write(targets)))

    def to_json(self) -> bytes:
        """See `SavableResult.to_json`; docs/calibrate.md says what is what."""
        return json_bytes(plain(self.as_dict()))

    def as_dict(self) -> dict[str, Any]:
        """Return the results as plain JSON values."""
        from markergen.calibration.words import verdict

        found, sightings = self.adjustment, self.sightings
        spread = np.sqrt(np.maximum(np.diag(found.covariance), 0)).reshape(-1, 3) if self.measured else None
        numbered = [(k, point.id) for k, marker in enumerate(self.designs) for point in marker.control_points]
        columns, views = found.weights > 0, np.flatnonzero(self.used)
        said, use = verdict(self)
        return {
            "verdict": said,
            "use": use,
            "rms_px": found.rms,
            "chi2": found.chi2,
            "degrees_of_freedom": found.degrees_of_freedom,
            "variance_factor": found.variance_factor,
            "scale": self.scale_source,
            "expected": {"before": asdict(self.before), "after": asdict(self.after)},
            "camera": {
                **self.camera.as_dict(),
                "estimated": self.estimated,
                "sigma": None
                if self.camera_covariance is None
                else dict(
                    zip(self.camera.parameter_names, np.sqrt(np.diag(self.camera_covariance)).tolist(), strict=True)
                ),
            },
            "dots": [
                {
                    "marker": numbered[index][0],
                    "id": numbered[index][1],
                    "place": found.places[column].tolist(),
                    "moved": (found.places[column] - found.network.design[column]).tolist(),
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
                    "rms_px": float(np.sqrt((found.residual[row][columns[row]] ** 2).sum(axis=-1).mean())),
                    "rejected": [numbered[index][1] for index in self.chosen[self.dropped[view]].tolist()],
                }
                for row, view in enumerate(views.tolist())
            ],
            "unused": {sightings.photos[k]: reason for k, reason in sightings.unused.items()},
            "left_out": self._left_out(),
            "halves": {"verdict": self.halves.verdict, "rms_um": self.halves.rms_um, "chance": self.halves.chance}
            if isinstance(self.halves, Halves)
            else {"reason": self.halves.reason},
            "flex": {"verdict": self.flex.verdict, "amplitude": self.flex.amplitude, "chance": self.flex.chance}
            if isinstance(self.flex, Flex)
            else {"reason": self.flex.reason},
            "notes": self.notes,
            **({} if self.relation is None else {"relation": self._relation()}),
        }

    def _relation(self) -> dict[str, Any]:
        assert self.relation is not None
        found, (turned, moved) = self.relation, self.relation.sigma
        rows = zip(found.rig.plates, found.turned_deg, found.moved, turned, moved, strict=True)
        return {
            "photographs": found.photographs,
            "looseness": found.looseness,
            "markers": [
                {
                    "name": each.name,
                    "T_rig_marker": {"rotation": each.rotation, "translation": each.translation},
                    "turned_deg": float(turn),
                    "moved": float(shift),
                    "sigma": {"rotation_deg": float(by_turn), "translation": float(by_shift)},
                }
                for each, turn, shift, by_turn, by_shift in rows
            ],
        }

    def _left_out(self) -> dict[str, Any]:
        found = self.cross_validation
        if isinstance(found, NotJudged):
            return {"reason": found.reason}
        rms = {"measured_px": found.measured.rms, "nominal_px": found.best_nominal.rms}
        gain = found.gain and {"gain": found.gain.ratio, "low": found.gain.low, "high": found.gain.high}
        return {"verdict": found.verdict, **rms, **(gain or {}), "better": found.better}
