"""``markergen.verify``: files read back and compared with the marker."""

import logging
from typing import Unpack

from markergen.api.arguments import files_among, paths_of
from markergen.api.export import choices_of, with_plates
from markergen.model.body_json import load_marker_or_rig
from markergen.options import given, takes
from markergen.options.declarations import VerifyKeywords
from markergen.options.kinds import File, Files, TargetLike
from markergen.units import parse_length
from markergen.verification.check import check_tolerance, verify_all
from markergen.verification.check import verify as verify_file
from markergen.verification.reading import Settings
from markergen.verification.result import Verification

_log = logging.getLogger(__name__)


@takes(VerifyKeywords)
def verify(
    marker: TargetLike,
    *files: File,
    save: Files = (),
    json: File | None = None,
    **options: Unpack[VerifyKeywords],
) -> Verification:
    """Read files back with independent readers, and compare everything in them with the marker.

    The dots are aligned with the marker's by the best rotation and translation, never by a scale: dots that are scaled,
    mirrored, missing or from another marker are reported as such. In solids of a rig, the places and rotations of its
    markers are compared, too. Files that only markergen writes are made again and compared value by value.

    Parameters
    ----------
    marker : Marker, Rig, path or dict
        The marker, or the rig, that the files should contain.
    *files : path
        Sheets, solids and configurations, read by suffix.
    save, json : path or None
        Files for the results: .json, or JSON under any name.
    **options
        As on the command line, ``markergen verify --help``: ``tolerance="0.1mm"``. Those of solids are what a file was
        made with, if it differs from marker.json, or is a simulator's model that does not record it.

    Returns
    -------
    Verification
        One check for each file, in order. If a file cannot be used, the `error` of its check says why, and the others
        are still verified.

    Raises
    ------
    InputError
        If the marker cannot be read, no file is given, one is not a path, or the tolerance is not above 0.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from markergen.exporters.saving import save
    >>> from markergen.model.boundary import Circle
    >>> from markergen.model.marker import build_marker
    >>> from markergen.objectives.criteria import regular_polygon
    >>> marker = build_marker(regular_polygon(5, 0.04), Circle(0.05), diameter=0.012, clearance=0.0012)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = save(marker, [Path(folder) / "marker.svg"])
    ...     found = verify(marker, Path(folder) / "marker.svg")
    >>> found.passed, found[0].dots
    (True, 5)
    """
    paths = paths_of(files, "files to verify")
    asked = given(options, VerifyKeywords)
    tolerance, unit = asked.pop("tolerance", None), asked.pop("unit", None)
    check_tolerance(tolerance)
    settings = Settings(
        tolerance, choices_of(asked).fabrication, None if unit is None else 1e3 * parse_length(f"1{unit}", "unit")
    )
    targets = Verification.targets(save, json=json)
    targets.check([*files_among(marker), *paths])
    body = with_plates(load_marker_or_rig(marker), asked)
    _log.info("verifying %d files", len(paths))
    checks = verify_all(lambda path: verify_file(body, path, settings), paths)
    _log.info("verified: %d of %d are as they should be", sum(check.passed for check in checks), len(checks))
    written = Verification(checks).write(targets)
    return Verification(checks, written)
