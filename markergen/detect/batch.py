"""Detection in many image files: an unreadable file is reported and does not stop the others."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from json import dumps
from pathlib import Path
from typing import Any, TextIO

from markergen.detect.detector import CovarianceSource, Detector, Found
from markergen.detect.presentation import overlay as drawn_over
from markergen.errors import InputError, OutputError
from markergen.files import check_outputs, make_folder, write_atomic
from markergen.options import Progress, as_list
from markergen.options.kinds import CameraLike, TargetLike
from markergen.pool import as_completed_chunks, chunks_of, workers_for
from markergen.read.images import Image, find_images, quiet, read_image
from markergen.read.videos import SUFFIXES

Task = tuple[Path, Path | None]
"""An image, and the file for its overlay."""

MANY, AT_ONCE = 200, 4
"""Number of images from which on processes are worth their start of a second, and number that each takes at a time.
Threads, which serve fewer, share large images as well, but small ones mostly take turns in Python."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result for one image.

    Attributes
    ----------
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
        return any(each.ok for each in self.markers)

    def without_image(self) -> "Outcome":
        """Return the same outcome without the image itself."""
        return replace(self, image=None)

    def lines(self) -> list[str]:
        """Return one line for the image and each marker in it, then the notes of the image reader."""
        if self.error:
            return [f"{self.path}: not used: {self.error}"]
        return [*(f"{self.path}: {each}" for each in self.markers), *(f"  {note}" for note in self.notes)]

    def as_dict(self) -> dict[str, Any]:
        """Return the outcome as plain JSON values (docs/detect.md)."""
        return {
            "image": str(self.path),
            "size": self.size,
            "notes": self.notes,
            "error": self.error or None,
            "markers": [each.as_dict() for each in self.markers],
        }

    def overlay(self) -> bytes | None:
        """Return the image as PNG bytes with all detections drawn in; None for an image that could not be used."""
        if self.image is None:
            return None
        # There is at least one result for each marker that was looked for.
        markers, camera = self.markers[0].markers, self.markers[0].camera
        return drawn_over(self.image.grey, markers, camera, [each.detection for each in self.markers if each.ok])


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
        found, unused = sum(each.found for each in self), sum(bool(each.error) for each in self)
        line = f"found a marker in {found} of {len(self)} image{'s' * (len(self) != 1)}"
        return f"{line}, {unused} could not be used" if unused else line

    def __repr__(self) -> str:
        return f"Outcomes({self})"

    @property
    def status(self) -> int:
        """Exit status: 0 if every image has a marker, 1 if one has none, 2 if one could not be used or written."""
        if any(each.error or each.unwritten for each in self):
            return 2
        return 0 if all(each.found for each in self) else 1

    def to_json(self) -> str:
        """Return one JSON array for all images (docs/detect.md)."""
        return dumps([each.as_dict() for each in self], indent=2, allow_nan=False) + "\n"


def detect_files(
    images: str | Path | Iterable[str | Path],
    markers: TargetLike | Iterable[TargetLike],
    camera: CameraLike | None = None,
    *,
    camera_covariance: CovarianceSource = None,
    print_sigma: str | float | None = None,
    symmetric: str = "none",
    smallest: float = 0.0,
    deadline: float | None = None,
    workers: int | None = None,
    window: bool | None = None,
    smooth: str | Sequence[float] | None = None,
    json: str | Path | TextIO | None = None,
    overlay: str | Path | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Outcomes:
    """Find markers in image files.

    A file that cannot be used, or an overlay that cannot be written, does not stop the others. The results are written
    as JSON at the end, even if the work is interrupted; they do not depend on the number of workers.

    Parameters
    ----------
    images
        Files, folders of them, or patterns such as ``*.png``.
    markers, camera, camera_covariance, print_sigma, symmetric, smallest
        As for `Detector`.
    deadline : float or None
        Seconds for one image, after which no further search is begun.
    workers : int or None
        Number of threads, or of processes for many images; None is one for each processor.
    window, smooth
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
    tell, warn = tell or _silent, warn or _silent
    if window or smooth is not None:
        raise InputError(f"a video or camera for --{'window' if window else 'smooth'}", "images", "leave it out")
    if overlay and Path(overlay).suffix.lower() in SUFFIXES:
        raise InputError("a folder for overlays of images", f"the video {overlay}", "give such an --overlay")
    sought = as_list(markers)
    detector = Detector(
        sought, camera, camera_covariance=camera_covariance, print_sigma=print_sigma, symmetric=symmetric,
        smallest=smallest,
    )  # fmt: skip
    paths = find_images(as_list(images), warn)
    at_once = workers_for(workers, len(paths))
    sources = [*sought, camera, camera_covariance]
    inputs = [*paths, *(Path(each) for each in sources if isinstance(each, str | Path))]
    drawings = [Path(overlay) / name for name in overlay_names(paths)] if overlay else []
    target, stream = (Path(json), None) if isinstance(json, str | Path) else (None, json)
    targets = [target] if target else []
    check_outputs(targets, inputs)
    if overlay:
        _check_apart(Path(overlay), paths)
        make_folder(Path(overlay))
    check_outputs([*targets, *drawings], inputs)
    for folder in filter(Path.is_dir, map(Path, as_list(images))):
        if videos := sum(each.suffix.lower() in SUFFIXES for each in folder.iterdir()):
            warn(f"{folder}: {videos} video{'s are' if videos > 1 else ' is'} left out: give one at a time")
    if detector.note:
        tell(detector.note)
    tasks = [(path, drawings[number] if overlay else None) for number, path in enumerate(paths)]
    done, told = dict[int, Outcome](), 0

    def finished(number: int, outcome: Outcome) -> None:
        nonlocal told
        done[number] = outcome
        # In the order of the images, whatever order they are done in.
        while told in done:
            now, told = done[told], told + 1
            with quiet.lifted():
                for line in now.lines():
                    (warn if now.error else tell)(line)
                if now.unwritten:
                    warn(f"{now.path}: {now.unwritten}")
                if progress:
                    progress("detecting", told, len(paths))

    try:
        if progress:
            progress("detecting", 0, len(paths))
        _look_at_all(partial(_look_at_some, detector, deadline), tasks, at_once, finished)
    finally:
        # Written even after an interruption, so that the results so far are not lost.
        outcomes = Outcomes(tuple(done[number] for number in sorted(done)))
        if len(done) < len(paths):
            warn(f"{len(done)} of {len(paths)} images were searched")
        if target:
            write_atomic(target, outcomes.to_json().encode())
            tell(f"wrote {target}")
        elif stream:
            stream.write(outcomes.to_json())
    if len(paths) > 1:
        tell(str(outcomes))
    return outcomes


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


def _look_at_all(
    look: Callable[[Sequence[Task]], list[Outcome]],
    tasks: Sequence[Task],
    workers: int,
    finished: Callable[[int, Outcome], None],
) -> None:
    """Call finished(number, outcome) for every task as it is done, in any order."""
    if workers > 1 and len(tasks) >= MANY:
        parts = chunks_of(len(tasks), AT_ONCE)
        chunks = [[tasks[number] for number in part] for part in parts]
        with closing(as_completed_chunks(look, chunks, workers)) as completed:
            for index, outcomes in completed:
                for number, outcome in zip(parts[index], outcomes, strict=True):
                    finished(number, outcome)
        return
    futures = dict[Future[list[Outcome]], int]()
    pool = ThreadPoolExecutor(workers)
    try:
        for number, task in enumerate(tasks):
            futures[pool.submit(look, [task])] = number
        for future in as_completed(futures):
            finished(futures.pop(future), *future.result())
    finally:
        pool.shutdown(cancel_futures=True)
        for future, number in futures.items():
            if future.done() and not future.cancelled() and not future.exception():
                finished(number, *future.result())


def _look_at_some(detector: Detector, deadline: float | None, tasks: Sequence[Task]) -> list[Outcome]:
    """Detect in some files, write their overlays, and drop the images: many would not fit into memory."""
    outcomes = []
    for path, drawing in tasks:
        outcome = look_at(detector, path, deadline)
        try:
            if drawing and (drawn := outcome.overlay()):
                write_atomic(drawing, drawn)
        except OutputError as error:
            outcome = replace(outcome, unwritten=str(error))
        outcomes.append(outcome.without_image())
    return outcomes


def overlay_names(paths: Sequence[Path]) -> list[str]:
    """Return distinct file names for image overlays, in order: the image's stem, numbered if it is repeated."""
    names, taken = [], set[str]()
    for path in paths:
        name, number = path.stem, 1
        while name in taken:
            number += 1
            name = f"{path.stem}-{number}"
        taken.add(name)
        names.append(f"{name}.png")
    return names


def _silent(line: str) -> None:
    """Say nothing."""
