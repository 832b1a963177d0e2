"""Detection in videos and live cameras, with a line of JSON and an annotated image for every frame."""

import json as json_format
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cached_property
from math import log10
from pathlib import Path
from time import monotonic
from typing import Any, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from markergen.detect.batch import json_paths, paths_among, silent
from markergen.detect.detector import Detector, check_deadline
from markergen.detect.presentation import Window, has_display
from markergen.detect.results import Found, lines_of
from markergen.detect.smoothing import Smoothed, Smoother, parse_accelerations, parse_readout
from markergen.errors import InputError, OutputError, enumerated
from markergen.files import check_outputs, put_in_place, temporary_beside
from markergen.options import as_list, signature_of
from markergen.options.declarations import DetectorKeywords
from markergen.options.kinds import CameraLike, TargetLike
from markergen.read.images import quiet
from markergen.read.videos import Video, VideoFrame, is_video, open_video, silent_opencv

CODECS = {".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
"""Codec by suffix of a video that is written."""

LEAST_FREE = 20_000_000
"""Free space in bytes below which no more is written to an annotated video: its end still has to fit."""

SECONDS_BETWEEN_WHOLE = 1.0
"""Time in s after which a whole frame is searched, although all markers were found where they had been: for copies of
them that have come in."""

USUAL_RATE = 25.0
"""Frames per second of an annotated video whose source states none."""


@dataclass(eq=False)
class Watched:
    """What was seen in a video, camera or stream.

    Attributes
    ----------
    frames, found : int
        Number of frames that were searched, and of those with a marker.
    dropped : int
        Number of live frames that were left out, because the search was not done with the one before.
    seconds : float
        Time from the first frame to the end of the last one's search.
    count : int or None
        Number of frames that a file states.
    """

    name: str
    frames: int = 0
    found: int = 0
    dropped: int = 0
    seconds: float = 0.0
    count: int | None = None

    @property
    def rate(self) -> float:
        """Frames searched per second; 0 before the first one."""
        return self.frames / self.seconds if self.seconds else 0.0

    @property
    def status(self) -> int:
        """Exit status: 0 if every frame has a marker, 1 if one has none."""
        return 0 if self.found == self.frames else 1

    def __str__(self) -> str:
        of_all = f"the first of {self.count}, " if self.count and self.frames < self.count else ""
        return (
            f"{self.name}: found a marker in {self.found} of {self.frames} frame{'s' * (self.frames != 1)}, {of_all}"
            f"{self.rate:.3g} frames per second, {self.dropped} dropped"
        )

    def __repr__(self) -> str:
        return f"Watched({self})"

    def lines(self, notes: Sequence[str] = ()) -> list[str]:
        """Return the sum of it all and the remarks on the video, if there was a frame."""
        return [str(self), *(f"  {note}" for note in notes)] if self.frames else []


def detect_video(
    source: str | Path | int | Sequence[str | Path | int],
    markers: TargetLike | Sequence[TargetLike],
    camera: CameraLike | None = None,
    *,
    deadline: float | None = None,
    workers: int | None = None,
    window: bool | None = None,
    smooth: str | Sequence[float] | None = None,
    readout: str | float | None = None,
    json: str | Path | TextIO | None = None,
    overlay: str | Path | None = None,
    show: Callable[[str], None] | None = None,
    tell: Callable[[str], None] | None = None,
    warn: Callable[[str], None] | None = None,
    **options: Any,
) -> Watched:
    """Find markers in every frame of a video, or in the newest ones of a camera or stream until it is interrupted.

    Outputs are complete, up to the last frame, even if an error or an interruption ends it.

    Parameters
    ----------
    source
        A video file, the number of a camera, the address of a stream, or a GStreamer pipeline.
    markers, camera, **options
        As for `Detector`.
    deadline : float or None
        Seconds for one frame, after which no further search is begun.
    workers
        For images alone.
    window : bool or None
        Show the frames with their detections; None is where there is a display, unless there is an overlay. Closing
        the window ends the detection.
    smooth : str or two floats
        Filter poses over time: accelerations in m/s^2 and rad/s^2 (see `markergen.detect.smoothing`).
    readout : str or float
        Time in s from the first row of a frame to the last, of a rolling shutter, whose filtered poses are corrected.
    json
        File or text stream for the results, one line of JSON for each frame, written at once.
    overlay
        File for a video with detections drawn in: .mp4, .m4v, .mov or .avi.
    show : callable
        Takes a line about each frame.
    tell, warn : callables
        Take lines for people: the sum of it all; what limits the outputs.

    Raises
    ------
    InputError
        If the source cannot be opened, a camera or stream stalls or ends, the frames are not of the camera's size, or
        an argument is invalid.
    OutputError
        If a file cannot be written, or an output is also an input.
    """
    tell, warn, show = tell or silent, warn or silent, show or silent
    sources = as_list(source)
    if len(sources) != 1:
        listed = f"{next(filter(is_video, sources), sources[0])} and {len(sources) - 1} more" if sources else "none"
        raise InputError("one video, camera or stream at a time", listed, "give images, and each video, by themselves")
    (one,) = sources
    if workers is not None:
        raise InputError("images for --workers", f"the video {one}", "leave it out: frames come one after the other")
    check_deadline(deadline)
    detector = Detector(markers, camera, **options)
    if smooth is not None and detector.camera is None:
        raise InputError("a camera for --smooth", "none, so that there are no poses", "give its --camera")
    if readout is not None and smooth is None:
        raise InputError("a filter for --readout", "none, so that there are no velocities", "give --smooth 2,10, too")
    rows = 0.0 if readout is None else parse_readout(readout)
    smoother = None if smooth is None else Smoother(parse_accelerations(smooth), rows)
    if overlay and Path(overlay).suffix.lower() not in CODECS:
        name = Path(overlay).with_suffix(".mp4")
        raise InputError(
            f"a name for a video that ends in {enumerated(CODECS)}", str(overlay), f"give --overlay {name}"
        )
    inputs = paths_among(one, *as_list(markers), camera, options.get("camera_covariance"))
    check_outputs([*json_paths(json), *paths_among(overlay)], inputs)
    size = (detector.camera.width, detector.camera.height) if detector.camera else None
    with ExitStack() as at_the_end:
        video = at_the_end.enter_context(open_video(one, size))
        watched = Watched(video.name, count=video.count)
        at_the_end.enter_context(silent_opencv())
        # The writer of an overlay may add to the video's notes.
        at_the_end.callback(
            lambda: [tell(line) for line in watched.lines([*filter(None, [detector.note]), *video.notes])]
        )
        # Images are drawn into after their data has been written.
        sinks: list[_Lines | _Overlay] = [at_the_end.enter_context(_Lines(json, tell))] if json else []
        sinks += [at_the_end.enter_context(_Overlay(Path(overlay), video, tell))] if overlay else []
        display = None
        try:
            if window or (window is None and has_display() and not overlay):
                display = Window(f"markergen: {video.name}")
                at_the_end.callback(display.close)
        except InputError as error:
            if window:
                raise
            warn(f"no window: {error}")
        for look in watch(video, detector, smoother, watched, deadline):
            for sink in sinks:
                sink.put(look)
            if display:
                display.show(look.drawn)
            show(str(look))
            if display and display.closed:
                break
        else:
            if not watched.frames:
                raise InputError(f"frames in {video.name}", "none", "convert it to .mp4 or .avi")
            if video.count and watched.frames < video.count:
                warn(f"{video.name}: {watched.frames} of the {video.count} frames that it states could be read")
    return watched


detect_video.__signature__ = signature_of(detect_video, DetectorKeywords)  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class Look:
    """A frame, what was found in it, the filtered poses if there is a filter, and the state of the detection."""

    frame: VideoFrame
    found: list[Found]
    smoothed: list[Smoothed | None] | None
    watched: Watched

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values (docs/detect.md)."""
        live = self.frame.clock is not None
        markers = [result.as_dict() for result in self.found]
        if self.smoothed is not None:
            for entry, pose in zip(markers, self.smoothed, strict=True):
                entry["smoothed"] = None if pose is None else pose.as_dict()
        return {
            "frame": self.frame.number,
            "time": self.frame.time,
            "clock": self.frame.clock,
            "dropped": self.frame.dropped,
            # The same video gives the same bytes, at any speed.
            "frames_per_second": self.watched.rate if live else None,
            "markers": markers,
        }

    @cached_property
    def drawn(self) -> NDArray[np.uint8]:
        """Return the frame's own image with all markers drawn in."""
        for result in self.found:
            if result.ok:
                result.draw(self.frame.image)
        return self.frame.image

    def __str__(self) -> str:
        return (
            f"{self.frame.time:.2f} s, {self.watched.rate:.3g} frames per second, {self.watched.dropped} dropped; "
            + "; ".join(lines_of(self.found))
        )


def watch(
    video: Video,
    detector: Detector,
    smoother: Smoother | None = None,
    watched: Watched | None = None,
    deadline: float | None = None,
) -> Iterator[Look]:
    """Yield each frame of a video with what is found in it, near where it was in the frame before if it still is.

    Parameters
    ----------
    smoother : Smoother, optional
        Filters the poses.
    watched : Watched, optional
        Counts the frames.
    deadline : float, optional
        Seconds for one frame, after which no further search is begun.

    Raises
    ------
    InputError
        If a camera or stream stalls or ends, or the frames are not of the camera's size.

    Examples
    --------
    >>> from markergen.detect import Detector
    >>> from markergen.read.videos import open_video
    >>> def follow(detector: Detector) -> None:
    ...     with open_video("0") as video:
    ...         for look in watch(video, detector):
    ...             print(look.frame.time, look.found[0].tvec)
    """
    watched = watched or Watched(video.name)
    start, results, whole = None, list[Found](), -np.inf
    for frame in video:
        start = monotonic() if start is None else start
        whole = frame.time if frame.time >= whole + SECONDS_BETWEEN_WHOLE else whole
        results = detector(frame.image, near=results, deadline=deadline, whole=frame.time <= whole)
        smoothed = smoother(frame.time, results) if smoother else None
        watched.frames += 1
        watched.found += any(result.ok for result in results)
        watched.dropped, watched.seconds = video.dropped, monotonic() - start
        yield Look(frame, results, smoothed, watched)


class _Lines:
    """JSON Lines, each of which is written at once: a program that follows gets it, and no accident loses it."""

    def __init__(self, target: str | Path | TextIO, tell: Callable[[str], None]) -> None:
        self._path = Path(target) if isinstance(target, str | Path) else None
        self._stream = None if isinstance(target, str | Path) else target
        self._whole = 0
        self._tell = tell

    def __enter__(self) -> Self:
        return self

    def put(self, look: Look) -> None:
        if self._path is None:
            self._write(look)
            return
        try:
            # Not before there is something to write.
            self._stream = self._stream or self._path.open("w", encoding="utf-8")
            self._write(look)
        except OSError as error:
            with suppress(OSError):
                if self._stream:
                    # First, since this writes what is left of the line.
                    self._stream.close()
            with suppress(OSError):
                os.truncate(self._path, self._whole)
            reason = f"{error.strerror or error} at frame {look.frame.number}"
            end = "it has all before that one, and later ones were not searched"
            raise OutputError(
                f"expected to write {self._path}, found: {reason}; {end}: free some space or choose another place"
            ) from error

    def _write(self, look: Look) -> None:
        assert self._stream is not None
        line = json_format.dumps(look.as_dict(), allow_nan=False) + "\n"
        self._stream.write(line)
        self._stream.flush()
        # All characters are ASCII.
        self._whole += len(line)

    def __exit__(self, *_: object) -> None:
        if self._path and self._stream:
            # What could not be written has been told.
            with suppress(OSError):
                self._stream.close()
            self._tell(f"wrote {self._path}")


class _Overlay:
    """A video of the frames with what was found drawn in, which replaces another only when it is complete."""

    def __init__(self, path: Path, video: Video, tell: Callable[[str], None]) -> None:
        self._path, self._tell = path, tell
        rate = video.rate or USUAL_RATE
        # MPEG-4 takes a rate of decimal places if it is below 65536 without its point.
        self._live, self._rate = video.live, round(rate, int(log10(65535 / rate)))
        self._temporary: Path | None = None
        self._writer: Any = None
        self._shape: tuple[int, ...] = ()
        self._written, self._last = 0, np.zeros((0, 0, 3), np.uint8)
        if video.rate is None:
            video.notes.append(f"the frame rate is unknown: {path} plays {USUAL_RATE:.0f} frames per second")

    def __enter__(self) -> Self:
        return self

    def put(self, look: Look) -> None:
        image = look.drawn
        if self._writer is None:
            self._open(image)
        if image.shape != self._shape:
            raise InputError(
                f"frames of {self._shape[1]}x{self._shape[0]} px, as the first one",
                f"{image.shape[1]}x{image.shape[0]} px",
                "leave out --overlay for a video that changes its size",
            )
        # What is live plays as fast as it was: a frame stays until the next one that was searched, if its time comes.
        due = round(look.frame.time * self._rate) if self._live else self._written
        while self._written < due:
            self._write(self._last)
        if self._written == due:
            self._write(image)
        if (free := shutil.disk_usage(self._path.resolve().parent).free) < LEAST_FREE:
            raise OutputError(
                f"expected space for {self._path}, found {free / 1e6:.0f} MB; it ends at frame {look.frame.number}, "
                "and later ones were not searched: free some space or choose another place"
            )

    def _write(self, image: NDArray[np.uint8]) -> None:
        self._writer.write(image)
        self._written, self._last = self._written + 1, image

    def _open(self, image: NDArray[np.uint8]) -> None:
        import cv2

        self._shape, self._temporary = image.shape, temporary_beside(self._path)
        height, width = image.shape[:2]
        code = cv2.VideoWriter.fourcc(*CODECS[self._path.suffix.lower()])
        with quiet:
            self._writer = cv2.VideoWriter(str(self._temporary), code, self._rate, (width, height))
        if not self._writer.isOpened():
            raise OutputError(
                f"expected to write {self._path}, found: OpenCV cannot write {self._path.suffix} files of {width}x"
                f"{height} px; try .avi"
            )
        if width % 2 or height % 2:
            self._tell(f"{self._path}: the codec takes even sizes alone, and cuts off the last row or column")

    def __exit__(self, *_: object) -> None:
        if self._temporary is None:
            return
        try:
            self._writer.release()
            self._check(self._temporary)
            put_in_place(self._temporary, self._path)
            self._tell(f"wrote {self._path}")
        finally:
            self._temporary.unlink(missing_ok=True)

    def _check(self, temporary: Path) -> None:
        """Raise OutputError unless all frames can be read back: OpenCV does not report a full disk."""
        import cv2

        with quiet:
            capture = cv2.VideoCapture(str(temporary))
            count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
            capture.release()
        # One more, if it was interrupted between writing and counting.
        if count < self._written:
            frames = f"{self._written} frame{'s' * (self._written != 1)}"
            full = ", since the disk is full" * (shutil.disk_usage(temporary.parent).free < LEAST_FREE)
            raise OutputError(
                f"expected to write {frames} to {self._path}, found {max(count, 0)} in it{full}; nothing was changed, "
                "free some space or choose another place"
            )
