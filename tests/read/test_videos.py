"""Every frame of a file, the newest ones of a camera, and one line for what cannot be read."""

import socket
import struct
import threading
import time
from itertools import pairwise

import cv2
import numpy as np
import pytest
from videos import FakeCamera, flat, write_video

from markergen.errors import InputError
from markergen.read import videos
from markergen.read.videos import is_video, open_video


@pytest.fixture
def camera(monkeypatch):
    """Plug in a camera: camera(frames, ...) returns it, and open_video opens it from then on."""

    def plug_in(*arguments, **options):
        camera = FakeCamera(*arguments, **options)
        monkeypatch.setattr(videos, "open_capture", lambda source, kind: camera)
        return camera

    return plug_in


@pytest.mark.parametrize("code", ["MJPG", "mp4v"])
def test_every_frame_of_a_file_in_order(tmp_path, code):
    path = tmp_path / ("a.avi" if code == "MJPG" else "a.mp4")
    write_video(path, flat(12), 30.0, code)
    with open_video(path, (640, 480)) as video:
        assert (video.live, video.count, video.rate, video.notes) == (False, 12, pytest.approx(30), [])
        frames = list(video)
    assert [item.number for item in frames] == list(range(12))
    assert [item.dropped for item in frames] == [0] * 12
    assert {item.clock for item in frames} == {None}
    np.testing.assert_allclose([item.time for item in frames], np.arange(12) / 30, atol=1e-6)
    for k, frame in enumerate(frames):
        assert frame.image.shape == (32, 48, 3)
        # Coded with losses, of less than half of what frames differ by.
        assert abs(float(frame.image.mean()) - 10 * k) < 5


def test_of_a_camera_the_newest_frame_and_the_number_of_the_others(camera):
    plugged, seen, before = camera(flat(12), on_demand=True), [], time.time()
    with open_video(0, (1920, 1080)) as video:
        assert (video.live, video.count, video.name) == (True, None, "camera 0")
        frames = iter(video)
        for count in (0, 3, 1, 1, 6):
            plugged.deliver(count)
            seen.append(next(frames))
            assert video.dropped == sum(item.dropped for item in seen)
        plugged.deliver()
        with pytest.raises(InputError, match="camera 0, found its end"):
            next(frames)
    assert [item.number for item in seen] == [0, 3, 4, 5, 11]
    assert [item.dropped for item in seen] == [0, 2, 0, 0, 5]
    assert [item.image[0, 0, 0] for item in seen] == [0, 30, 40, 50, 110]
    # It was asked for frames of the calibration's size.
    assert plugged.asked[cv2.CAP_PROP_FRAME_WIDTH] == 1920
    assert plugged.asked[cv2.CAP_PROP_FRAME_HEIGHT] == 1080
    assert plugged.released
    assert seen[0].time == 0
    assert all(one.time < other.time for one, other in pairwise(seen))
    assert before - 1 < seen[0].clock < seen[-1].clock < time.time() + 1


def test_a_camera_that_stalls_is_told(camera, monkeypatch):
    monkeypatch.setattr(videos, "STALLED", 0.1)
    plugged = camera(flat(2), stalls=True)
    seen = []
    video = open_video("rtsp://camera/1")
    with pytest.raises(InputError, match="from rtsp://camera/1, found none"):
        seen += video
    # The first one may have been replaced before it was asked for.
    assert seen[-1].number == 1
    plugged.go.set()
    video.close()
    assert plugged.released


def test_an_error_of_opencv_is_one_line(camera, monkeypatch):
    plugged = camera(flat(3))

    def broken():
        raise cv2.error("(-215:Assertion failed) in some function")

    monkeypatch.setattr(plugged, "retrieve", broken)
    with open_video("0") as video, pytest.raises(InputError, match=r"camera 0, found .*Assertion"):
        list(video)


def test_a_file_is_left_in_the_middle(tmp_path):
    write_video(tmp_path / "a.avi", flat(12))
    threads = threading.active_count()
    with open_video(tmp_path / "a.avi") as video:
        for frame in video:
            if frame.number == 3:
                break
    assert threading.active_count() == threads


def test_time_stamps_increase(camera, monkeypatch):
    """Those of this file do not: all are 0, and 25 frames per second are stated."""
    camera(flat(4))
    monkeypatch.setattr(videos, "_kind", lambda source: "file")
    with open_video("a.mp4") as video:
        times = [item.time for item in video]
    np.testing.assert_allclose(times, [0, 0.04, 0.08, 0.12])
    assert video.notes == [videos.TIME_NOTE]


def test_a_rotation_is_ignored_and_told(tmp_path):
    """As phones state it: by a matrix in the header of the track."""
    path = tmp_path / "turned.mp4"
    write_video(path, flat(2), code="mp4v")
    content = bytearray(path.read_bytes())
    matrix = content.index(b"tkhd") + 44
    assert struct.unpack_from(">9i", content, matrix) == (1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
    struct.pack_into(">9i", content, matrix, 0, 1 << 16, 0, -1 << 16, 0, 0, 0, 0, 1 << 30)
    path.write_bytes(content)
    assert cv2.VideoCapture(str(path)).read()[1].shape == (48, 32, 3)
    with open_video(path) as video:
        assert video.notes == [videos.TURN_NOTE]
        assert [item.image.shape for item in video] == [(32, 48, 3)] * 2


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("none.mp4", "a readable video none.mp4, found no such file; check the path"),
        ("text.mp4", "a readable video text.mp4, found one that is damaged or not a video"),
        ("cut.mp4", "a readable video cut.mp4, found one that is damaged"),
        ("977", "a camera 977, found none that opens; check its number"),
        ("/dev/video977", "a camera /dev/video977, found none"),
        ("rtsp://127.0.0.1:9/x", "a stream at rtsp://127.0.0.1:9/x, found none that opens"),
        ("nosuch://x", "a stream at nosuch://x, found none that opens"),
    ],
)
def test_what_cannot_be_opened_is_one_line(tmp_path, monkeypatch, capfd, source, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.mp4").write_text("no video\n" * 100)
    write_video(tmp_path / "whole.mp4", flat(12), code="mp4v")
    (tmp_path / "cut.mp4").write_bytes((tmp_path / "whole.mp4").read_bytes()[:-500])
    with pytest.raises(InputError) as caught:
        open_video(source)
    assert message in str(caught.value)
    # OpenCV and FFmpeg would say more.
    assert capfd.readouterr() == ("", "")


def test_a_server_that_never_answers(monkeypatch):
    monkeypatch.setattr(videos, "STALLED", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as server:
        start = time.monotonic()
        with pytest.raises(InputError, match="none that opens"):
            open_video(f"http://127.0.0.1:{server.getsockname()[1]}/video")
        assert time.monotonic() - start < 10


def test_a_pipeline_without_gstreamer_says_what_is_missing(monkeypatch):
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "Video I/O:\n    GStreamer:                   NO\n")
    with pytest.raises(InputError, match=r"GStreamer for a pipeline, found OpenCV .*"):
        open_video("videotestsrc ! appsink")


def test_what_is_a_video(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for source in (0, "0", "12", "a.MP4", tmp_path / "b.mkv", "/dev/video0", "http://x/y", "v4l2src ! appsink"):
        assert is_video(source), source
    (tmp_path / "3").write_bytes(b"")
    (tmp_path / "shots.mov").mkdir()
    for source in ("3", "shots.mov", "a.png", "*.jpg", "shots", "-1", "²", 10 * "9", "a.json"):
        assert not is_video(source), source
