"""Short videos and cameras that are none, for tests of the detection in them."""

import threading

import cv2
import numpy as np


def write_video(path, frames, rate=25.0, code="MJPG"):
    """Write grey frames as a video."""
    height, width = frames[0].shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), rate, (width, height))
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()


def read_video(path):
    """Read all frames of a video."""
    capture, frames = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        frames.append(read[1])
    capture.release()
    return frames


class FakeCamera:
    """A camera that delivers frames, one after the other or on demand, and then ends or stalls.

    Parameters
    ----------
    frames : list of arrays (h, w), grey
    on_demand : bool
        After the first one, frames come when the test calls `deliver`.
    stalls : bool
        Whether it waits after the last one, as a stream may, instead of saying that there are no more.
    """

    def __init__(self, frames, on_demand=False, stalls=False, rate=25.0):
        self.frames, self.stalls, self.rate = [*frames], stalls, rate
        self.asked, self.released, self.go = {}, False, threading.Event()
        self.changed = threading.Condition()
        self.allowed, self.grabbed = 1 if on_demand else len(frames) + 1, 0

    def deliver(self, count=1):
        """Let the reader take frames, or the end, and return when it has."""
        with self.changed:
            self.allowed += count
            self.changed.notify_all()
            assert self.changed.wait_for(lambda: self.grabbed > min(self.allowed, len(self.frames)), 20)

    def grab(self):
        with self.changed:
            # Counted when it is asked for: then the one before is in the reader's hands.
            self.grabbed += 1
            self.changed.notify_all()
            self.changed.wait_for(lambda: self.grabbed <= self.allowed, 20)
        if self.grabbed > len(self.frames) and self.stalls:
            self.go.wait(20)
        return self.grabbed <= len(self.frames)

    def retrieve(self):
        return True, cv2.cvtColor(self.frames[self.grabbed - 1], cv2.COLOR_GRAY2BGR)

    def get(self, prop):
        return self.rate if prop == cv2.CAP_PROP_FPS else 0.0

    def set(self, prop, value):
        self.asked[prop] = value
        return True

    def release(self):
        self.released = True


def flat(count, size=(32, 48)):
    """Frames of one grey level each, 10 apart."""
    return [np.full(size, 10 * k, np.uint8) for k in range(count)]
