"""Frames of videos and cameras: every one of a file, the newest one of what is live, with those left out counted."""

import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError
from markergen.files import exists
from markergen.read.images import quiet

if TYPE_CHECKING:
    from cv2 import VideoCapture

SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".mts", ".ts", ".webm", ".wmv")
"""Suffixes of the files that count as videos."""

STALLED = 10.0
"""Longest wait in s for a frame of a camera or stream, and for a stream to open."""

AHEAD = 2
"""Number of frames of a file that are decoded ahead."""

TURN_NOTE = "the video's rotation is ignored: the camera's calibration is for the sensor as it is"
TIME_NOTE = "time stamps that do not increase are replaced by those of the frame rate"
"""Remarks on a video."""


SOURCES = {
    "camera": ("a camera", "none that opens", "check its number, its cable, and that no other program uses it"),
    "stream": ("a stream at", "none that opens", "check the address and the network"),
    "pipeline": ("a pipeline", "one that does not start", "try it with gst-launch-1.0, and end it in appsink"),
    "file": ("a readable video", "one that is damaged or not a video", "convert it to .mp4 or .avi"),
}
"""What a source is called, and what is wrong with one that does not open."""


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A frame.

    Attributes
    ----------
    number : int
        Position in the video, from 0; frames that were left out count.
    time : float
        Time stamp of the video, or the time since the first frame of what is live, s.
    clock : float or None
        Time of arrival of a live frame, s since 1970; None for a file.
    dropped : int
        Number of frames left out just before this one; 0 for a file.
    image : array (h, w, 3) of uint8, BGR
    """

    number: int
    time: float
    clock: float | None
    dropped: int
    image: NDArray[np.uint8]


def is_video(source: str | Path | int) -> bool:
    """Return whether this names a video, a camera or a stream, and no image.

    A number is a camera, unless a file has that name; ``://`` is in an address, and `` ! `` in a pipeline.

    >>> [is_video(each) for each in ("walk.mp4", "0", "rtsp://camera/1", "v4l2src ! appsink", "photo.png", "photos")]
    [True, True, True, True, False, False]
    """
    text = str(source)
    if _kind(text) != "file":
        return True
    return Path(text).suffix.lower() in SUFFIXES and not (exists(Path(text)) and Path(text).is_dir())


def open_video(source: str | Path | int, size: tuple[int, int] | None = None) -> "Video":
    """Open a video file, a camera by its number, the address of a stream, or a GStreamer pipeline that ends in appsink.

    Raises InputError if it cannot be opened.

    Parameters
    ----------
    size : (width, height) in px, or None
        Asked of a camera, which may still deliver another.
    """
    import cv2

    text = str(source)
    kind = _kind(text)
    capture = open_capture(text, kind)
    if size is not None and kind == "camera":
        capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
        capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    count, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
    # The address of a file is one, too: only what has no end is live.
    live = kind in ("camera", "pipeline") or (kind == "stream" and not count > 0)
    is_rotated = capture.get(cv2.CAP_PROP_ORIENTATION_META) in (90, 180, 270)
    return Video(
        f"camera {text}" if kind == "camera" and text.isdecimal() else text,
        live,
        rate if 0 < rate <= 1000 else None,
        int(count) if count > 0 and not live else None,
        [TURN_NOTE] if is_rotated else [],
        capture,
    )


def size_in_video(path: Path) -> tuple[int, int] | None:
    """Return width and height in px of the frames of a file, as they are read; None for what is live or unreadable."""
    import cv2

    if _kind(str(path)) != "file":
        return None
    try:
        capture = open_capture(str(path), "file")
    except InputError:  # `open_video` says why.
        return None
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    capture.release()
    return size if min(size) > 0 else None


def open_capture(source: str, kind: str) -> "VideoCapture":
    """Open a source with OpenCV, which then says nothing; raises InputError if that fails."""
    import cv2

    what, problem, remedy = SOURCES[kind]
    expected = f"{what} {source}"
    if kind == "file" and not exists(Path(source)):
        raise InputError(expected, "no such file", "check the path")
    # FFmpeg reads it when it is first used.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    if kind == "pipeline" and "GStreamer:                   YES" not in cv2.getBuildInformation():
        remedy = "give a file, an address or a camera's number, or install an OpenCV that was built with it"
        raise InputError("an OpenCV with GStreamer for a pipeline", f"OpenCV {cv2.__version__} without it", remedy)
    with quiet:
        if kind == "pipeline":
            capture = cv2.VideoCapture(source, cv2.CAP_GSTREAMER)
        elif kind == "stream":
            # Our own limit for a frame comes before that of FFmpeg, which would print about it.
            limit = int(1000 * STALLED)
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, limit, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 3 * limit]
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)
        else:
            capture = cv2.VideoCapture(int(source) if source.isdecimal() and kind == "camera" else source)
    if not capture.isOpened():
        raise InputError(expected, problem, remedy)
    return capture


@contextmanager
def silent_opencv() -> Iterator[None]:
    """Keep OpenCV from printing about every frame that it cannot write, or about a stream that ends."""
    from cv2.utils import logging

    before = logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(before)


@dataclass(eq=False, repr=False)
class Video:
    """An open video, camera or stream, whose frames are read in a thread of their own; iterate once, then close.

    Attributes
    ----------
    live : bool
        Only the newest frame is kept, and others are dropped.
    rate : float or None
        Frames per second, as stated.
    count : int or None
        Number of frames of a file, as stated.
    notes : list of str
        Remarks for the user; complete at the end.
    dropped : int
        Number of frames dropped so far.
    """

    name: str
    live: bool
    rate: float | None
    count: int | None
    notes: list[str]
    _capture: "VideoCapture"
    dropped: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self._changed = threading.Condition()
        self._ready = deque[VideoFrame]()
        self._ended = self._closed = False
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[VideoFrame]:
        """Yield the frames; raises InputError where one cannot be read, or a camera or stream stalls or ends."""
        while True:
            with self._changed:
                if not self._changed.wait_for(lambda: self._ready or self._ended, STALLED if self.live else None):
                    remedy = "check the camera and its connection"
                    raise InputError(f"a frame from {self.name}", f"none for {STALLED:.0f} s", remedy)
                if not self._ready:
                    break
                frame = self._ready.popleft()
                self.dropped += frame.dropped
                self._changed.notify_all()
            yield frame
        if self._failure is not None:
            problem = " ".join(str(self._failure).split())[:80] or type(self._failure).__name__
            raise InputError(f"frames from {self.name}", problem, "convert a file to .mp4 or .avi, restart a camera")
        if self.live:
            raise InputError(f"frames from {self.name}", "its end", "check the camera and its connection")

    def close(self) -> None:
        """End the thread and release the source."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(2)
        # While it waits inside OpenCV, for a stalled stream, the source must not be released.
        if not self._thread.is_alive():
            self._capture.release()

    def _read(self) -> None:
        try:
            for number, (stamp, clock, image) in enumerate(self._images()):
                with self._changed:
                    dropped = 0
                    if self.live and self._ready:
                        dropped = self._ready.popleft().dropped + 1
                    self._changed.wait_for(lambda: len(self._ready) < AHEAD or self._closed)
                    if self._closed:
                        return
                    self._ready.append(VideoFrame(number, stamp, clock, dropped, image))
                    self._changed.notify_all()
        except Exception as error:  # Of OpenCV, or no memory: raised where the frames are taken.
            self._failure = error
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _images(self) -> Iterator[tuple[float, float | None, NDArray[Any]]]:
        """Yield the time stamp, the clock, and the image of each frame."""
        import cv2

        start, last = None, -np.inf
        while self._capture.grab():
            now, clock = time.monotonic(), time.time() if self.live else None
            ok, image = self._capture.retrieve()
            if not ok:
                return
            start = now if start is None else start
            stamp = now - start if self.live else self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            if stamp <= last:
                stamp = last + 1 / (self.rate or 25)
                if TIME_NOTE not in self.notes:
                    self.notes.append(TIME_NOTE)
            last = stamp
            yield stamp, clock, image


def _kind(source: str) -> str:
    if " ! " in source:
        return "pipeline"
    if "://" in source:
        return "stream"
    # A longer number is none of OpenCV's.
    number = source.isdecimal() and source.isascii() and len(source) < 10
    if source.startswith("/dev/video") or (number and not exists(Path(source))):
        return "camera"
    return "file"
