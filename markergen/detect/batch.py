"""Detection in many image files: an unreadable file is reported and does not stop the others."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import count
from json import dumps
from pathlib import Path
from typing import Any, TextIO

from markergen.detect.detector import Detector, check_deadline
from markergen.detect.presentation import overlay as drawn_over
from markergen.detect.results import Found, lines_of
from markergen.errors import InputError, OutputError
from markergen.files import check_outputs, make_folder, write_atomic
from markergen.options import Progress, as_list, signature_of
from markergen.options.declarations import DetectorKeywords
from markergen.options.kinds import CameraLike, TargetLike
from markergen.pool import workers_for
from markergen.read.images import Image, find_images, quiet, read_image
from markergen.read.videos import SUFFIXES


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result for one image.

    Attributes
    ----------
    image : Image or None
        The image itself, while it is needed.
    size : tuple (width, height) or None
        Size of the image, px.
    notes : tuple of str
        Remarks of the image reader.
    markers : tuple of Found
        Results, in the order of `Detector`.
    error : str
        Why the image could not be used; empty otherwise.
    unwritten : str
        Why its overlay could not be written; empty otherwise.
    """

    path: Path
    image: Image | None
    size: tuple[int, int] | None
    notes: tuple[str, ...]
    markers: tuple[Found, ...]
    error: str = ""
    unwritten: str = ""

    @property
    def found(self) -> bool:
        """True if at least one marker was found."""
        return any(marker.ok for marker in self.markers)

    def without_image(self) -> "Outcome":
        """Return the same outcome without the image itself."""
        return replace(self, image=None)

    def lines(self) -> list[str]:
        """Return the lines of the markers, each with the image, then the notes of the image reader."""
        if self.error:
            return [f"{self.path}: not used: {self.error}"]
        return [*(f"{self.path}: {line}" for line in lines_of(self.markers)), *(f"  {note}" for note in self.notes)]

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as plain JSON values (docs/detect.md)."""
        return {
            "image": str(self.path),
            "size": self.size,
            "notes": self.notes,
            "error": self.error or None,
            "markers": [marker.as_dict() for marker in self.markers],
        }

    def overlay(self) -> bytes | None:
        """Return the image as PNG bytes with all detections drawn in; None for an image that could not be used."""
        hits = [marker for marker in self.markers if marker.ok]
        return None if self.image is None else drawn_over(self.image.grey, hits)


@dataclass(frozen=True, eq=False)
class Outcomes:
    """The results for many images.

    Attributes
    ----------
    images : tuple of Outcome
        Outcomes in the order of the images, without the images themselves.
    """

    images: tuple[Outcome, ...]

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[Outcome]:
        return iter(self.images)

    def __getitem__(self, index: int) -> Outcome:
        return self.images[index]

    def __str__(self) -> str:
        hits, unused = sum(outcome.found for outcome in self), sum(bool(outcome.error) for outcome in self)
        line = f"found a marker in {hits} of {len(self)} image{'s' * (len(self) != 1)}"
        return f"{line}, {unused} could not be used" if unused else line

    def __repr__(self) -> str:
        return f"Outcomes({self})"

    @property
    def status(self) -> int:
        """Exit status: 0 if every image has a marker, 1 if one has none, 2 if one could not be used or written."""
        if any(outcome.error or outcome.unwritten for outcome in self):
            return 2
        return 0 if all(outcome.found for outcome in self) else 1

    def to_json(self) -> str:
        """Return one JSON array for all images (docs/detect.md)."""
        return dumps([outcome.as_dict() for outcome in self], indent=2, allow_nan=False) + "\n"


def detect_files(
    images: str | Path | Iterable[str | Path],
    markers: TargetLike | Iterable[TargetLike],
    camera: CameraLike | None = None,
    *,
    deadline: float | None = None,
    workers: int | None = None,
    window: bool | None = None,
    smooth: str | Sequence[float] | None = None,
    readout: str | float | None = None,
    json: str | Path | TextIO | None = None,
    overlay: str | Path | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
    warn: Callable[[str], None] | None = None,
    **options: Any,
) -> Outcomes:
    """Find markers in image files.

    A file that cannot be used, or an overlay that cannot be written, does not stop the others. The results are written
    as JSON at the end, even if the work is interrupted; they do not depend on the number of workers.

    Parameters
    ----------
    images
        Files, folders of them, or patterns such as ``*.png``.
    markers, camera, **options
        As for `Detector`.
    deadline : float or None
        Seconds for one image, after which no further search is begun.
    workers : int or None
        Number of threads; None is one for each processor.
    window, smooth, readout
        For videos alone.
    json
        File or text stream for the results.
    overlay
        Folder for the images with detections drawn in.
    progress : callable (stage, done, total)
    tell, warn : callables
        Take lines for people: results; images that cannot be used and overlays that cannot be written.

    Raises
    ------
    InputError
        If there are no images, or an argument is invalid (see `Detector`).
    OutputError
        If a file cannot be written, an output is also an input, or the overlays would stand among the inputs.
    """
    tell, warn = tell or silent, warn or silent
    if readout is not None:
        raise InputError("a video and --smooth for --readout", "images, which show no velocity", "leave it out")
    if window or smooth is not None:
        raise InputError(f"a video or camera for --{'window' if window else 'smooth'}", "images", "leave it out")
    if overlay and Path(overlay).suffix.lower() in SUFFIXES:
        raise InputError("a folder for overlays of images", f"the video {overlay}", "give such an --overlay")
    check_deadline(deadline)
    detector = Detector(markers, camera, **options)
    paths = find_images(as_list(images), warn)
    at_once = workers_for(workers, len(paths))
    inputs = [*paths, *paths_among(*as_list(markers), camera, options.get("camera_covariance"))]
    drawings = [Path(overlay) / name for name in overlay_names(paths)] if overlay else []
    targets = json_paths(json)
    check_outputs(targets, inputs)
    if overlay:
        _check_apart(Path(overlay), paths)
        make_folder(Path(overlay))
    check_outputs([*targets, *drawings], inputs)
    for folder in filter(Path.is_dir, map(Path, as_list(images))):
        if videos := sum(path.suffix.lower() in SUFFIXES for path in folder.iterdir()):
            warn(f"{folder}: {videos} video{'s are' if videos > 1 else ' is'} left out: give one at a time")
    if detector.note:
        tell(detector.note)
    if progress:
        progress("detecting", 0, len(paths))
    pool, futures = ThreadPoolExecutor(at_once), list[Future[Outcome]]()
    try:
        for number, path in enumerate(paths):
            futures.append(pool.submit(_look_and_draw, detector, path, deadline, drawings[number] if overlay else None))
        # In the order of the images, whatever order they are done in.
        for done, future in enumerate(futures, 1):
            outcome = future.result()
            with quiet.lifted():
                for line in outcome.lines():
                    (warn if outcome.error else tell)(line)
                if outcome.unwritten:
                    warn(f"{outcome.path}: {outcome.unwritten}")
                if progress:
                    progress("detecting", done, len(paths))
    finally:
        # Written even after an interruption, so that the results so far are not lost.
        pool.shutdown(cancel_futures=True)
        ready = [future for future in futures if not future.cancelled() and not future.exception()]
        outcomes = Outcomes(tuple(future.result() for future in ready))
        if len(outcomes) < len(paths):
            warn(f"{len(outcomes)} of {len(paths)} images were searched")
        for target in targets:
            write_atomic(target, outcomes.to_json().encode())
            tell(f"wrote {target}")
        if json and not targets:
            json.write(outcomes.to_json())  # type: ignore[union-attr]
    if len(paths) > 1:
        tell(str(outcomes))
    return outcomes


detect_files.__signature__ = signature_of(detect_files, DetectorKeywords)  # type: ignore[attr-defined]


def paths_among(*things: Any) -> list[Path]:
    """Return the paths among inputs or outputs, some of which may be in memory."""
    return [Path(thing) for thing in things if isinstance(thing, str | Path)]


TABLES = (".csv", ".tsv", ".xls", ".xlsx", ".parquet")


def json_paths(json: str | Path | TextIO | None) -> list[Path]:
    """Return the path for results as JSON, if it is one; raises InputError if it is named as a table is."""
    paths = paths_among(json)
    for path in paths:
        if path.suffix.lower() in TABLES:
            remedy = f"give --json {path.with_suffix('.json')}; docs/detect.md says what is in it"
            raise InputError("a name for JSON", str(path), remedy)
    return paths


def silent(line: str) -> None:
    """Print nothing."""


def _check_apart(folder: Path, paths: Sequence[Path]) -> None:
    """Refuse a folder with images that are searched: the overlays would pass for photographs the next time."""
    inside = next((path for path in paths if path.resolve().parent == folder.resolve()), None)
    if inside is not None:
        raise OutputError(
            f"expected a folder for overlays without any of the images, found {folder} with {inside.name}; "
            f"name another one, such as --overlay {folder / 'seen'}"
        )


def look_at(detector: Detector, path: Path, deadline: float | None = None) -> Outcome:
    """Detect the detector's markers in one file."""
    try:
        image = read_image(path)
        return Outcome(path, image, image.grey.shape[::-1], image.notes, tuple(detector(image.grey, deadline=deadline)))
    except InputError as error:
        return Outcome(path, None, None, (), (), str(error))


def _look_and_draw(detector: Detector, path: Path, deadline: float | None, drawing: Path | None) -> Outcome:
    """Detect in a file, write its overlay, and drop the image: many would not fit into memory."""
    outcome = look_at(detector, path, deadline)
    try:
        if drawing and (drawn := outcome.overlay()):
            write_atomic(drawing, drawn)
    except OutputError as error:
        outcome = replace(outcome, unwritten=str(error))
    return outcome.without_image()


def overlay_names(paths: Sequence[Path]) -> list[str]:
    """Return distinct file names for image overlays, in order: the image's stem, numbered if it is repeated."""
    taken = dict[str, None]()
    for path in paths:
        names = (path.stem if number == 1 else f"{path.stem}-{number}" for number in count(1))
        taken[next(name for name in names if name not in taken)] = None
    return [f"{name}.png" for name in taken]
