"""The same as for images, frame by frame, with outputs that are complete however it ends."""

import errno
import io
import json
import os
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from videos import FakeCamera, read_video, write_video

from markergen.detect import Detector, video
from markergen.detect.video import Watched, detect_video
from markergen.errors import InputError, OutputError
from markergen.model.body_json import to_json
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.read import videos
from markergen.render import Optics, render_view

POSES = paper()
EMPTY = 2
"""The frame without the marker."""


@pytest.fixture(scope="module")
def frames(pentagon):
    """Five frames of a marker that moves on, and is away in one of them."""
    rotation, start = POSES.rotation[130], POSES.translation[130]
    printed = [
        render_view(pentagon, PAPER_CAMERA, rotation, start + [0.01 * k, 0, 0], Optics(), np.random.default_rng(k))
        for k in range(5)
    ]
    printed[EMPTY] = np.full((480, 640), 200, np.uint8)
    return printed


@pytest.fixture
def folder(tmp_path, monkeypatch, frames, pentagon):
    """A folder with a video and its marker, and no display."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.chdir(tmp_path)
    write_video(tmp_path / "walk.avi", frames)
    (tmp_path / "marker.json").write_bytes(to_json(pentagon))
    return tmp_path


@pytest.fixture
def camera(monkeypatch):
    """Plug in a camera: camera(frames, ...)."""

    def plug_in(*arguments, **options):
        plugged = FakeCamera(*arguments, **options)
        monkeypatch.setattr(videos, "open_capture", lambda source, kind: plugged)
        return plugged

    return plug_in


def entries(text):
    return [json.loads(line) for line in text.splitlines()]


def watch(source="walk.avi", **options):
    return detect_video(source, "marker.json", PAPER_CAMERA, **options)


def test_a_video(folder, frames):
    output, warned, printed = [], [], []
    watched = watch(json="found.jsonl", overlay="seen.mp4", show=printed.append, tell=output.append, warn=warned.append)
    assert (watched.frames, watched.found, watched.dropped, watched.status) == (5, 4, 0, 1)
    assert sorted(output) == sorted(["wrote found.jsonl", "wrote seen.mp4", str(watched)])
    assert str(watched).startswith("walk.avi: found a marker in 4 of 5 frames, ")
    assert not warned
    assert len(printed) == 5
    assert "0.04 s, " in printed[1]
    assert "5 of 5 dots" in printed[1]
    lines = entries((folder / "found.jsonl").read_text())
    assert [line["frame"] for line in lines] == [0, 1, 2, 3, 4]
    np.testing.assert_allclose([line["time"] for line in lines], np.arange(5) / 25, atol=1e-6)
    assert [line["markers"][0]["found"] for line in lines] == [k != EMPTY for k in range(5)]
    # As found in the same frames one by one.
    detector, findings = Detector("marker.json", PAPER_CAMERA), None
    for entry, image in zip(lines, read_video("walk.avi"), strict=True):
        findings = detector(image, near=findings)
        assert entry["markers"] == [line.as_dict() for line in findings]
    drawn = read_video("seen.mp4")
    assert [line.shape for line in drawn] == [(480, 640, 3)] * 5
    # Orange and blue are on the drawn ones alone, which are grey otherwise.
    colored = [int((np.ptp(line.astype(int), axis=-1) > 60).sum()) for line in drawn]
    assert colored[EMPTY] == 0
    assert min(colored[:EMPTY] + colored[EMPTY + 1 :]) > 300
    assert sorted(line.name for line in folder.iterdir()) == ["found.jsonl", "marker.json", "seen.mp4", "walk.avi"]


def test_the_loop_of_the_documentation(folder, capsys):
    text = (Path(__file__).parents[2] / "docs" / "detect.md").read_text()
    (code,) = (item for item in text.split("```") if "import watch" in item)
    (folder / "walk.avi").rename("video.avi")
    detector = Detector("marker.json", PAPER_CAMERA)
    exec(compile(code.removeprefix("python\n"), "docs/detect.md", "exec"), {"detector": detector})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines] == ["0"] * 5
    assert [line.endswith("[None]") for line in lines] == [k == EMPTY for k in range(5)]


def test_the_same_video_gives_the_same_bytes(folder):
    written = []
    for _ in range(2):
        stream = io.StringIO()
        watch(json=stream, overlay="seen.avi", smooth=(2, 10))
        written.append((stream.getvalue(), (folder / "seen.avi").read_bytes()))
    assert written[0] == written[1]
    smoothed = [entry["markers"][0]["smoothed"] for entry in entries(written[0][0])]
    assert [entry is None for entry in smoothed] == [k == EMPTY for k in range(5)]
    # 10 mm in each frame, 25 of which make a second.
    np.testing.assert_allclose(smoothed[-1]["velocity"], [0.25, 0, 0], atol=0.03)
    # Without it, there is no such entry.
    stream = io.StringIO()
    watch(json=stream)
    assert "smoothed" not in stream.getvalue()


def test_a_camera_until_it_ends(folder, frames, camera, monkeypatch):
    """What was seen before the end is written, and plays as fast as it was."""
    plugged = camera(frames, on_demand=True)
    stamps, clock = iter(np.arange(100) * 0.08), iter(range(100))
    time = SimpleNamespace(monotonic=lambda: float(next(stamps)), time=lambda: 1.8e9 + next(clock))
    monkeypatch.setattr(videos, "time", time)
    output, stream = [], io.StringIO()

    def deliver(line):
        # Two more while the first frame is searched; then one by one.
        plugged.deliver(2 if line.startswith("0.00 s") else 1)

    with pytest.raises(InputError, match="frames from camera 0, found its end"):
        watch("0", json=stream, overlay="seen.mp4", show=deliver, tell=output.append)
    lines = entries(stream.getvalue())
    assert [item["frame"] for item in lines] == [0, 2, 3, 4]
    assert [item["dropped"] for item in lines] == [0, 1, 0, 0]
    np.testing.assert_allclose([item["time"] for item in lines], [0, 0.16, 0.24, 0.32])
    assert [item["clock"] - 1.8e9 for item in lines] == [0, 2, 3, 4]
    assert all(item["frames_per_second"] > 0 for item in lines)
    assert "camera 0: found a marker in 3 of 4 frames" in output[-1]
    assert "1 dropped" in output[-1]
    # 25 frames per second are stated, and there were 12.5: each stays for two, the one before the drop for four.
    assert [bool(np.ptp(item) > 100) for item in read_video("seen.mp4")] == [True] * 4 + [False] * 2 + [True] * 3


def test_a_copy_that_comes_in_is_found_within_a_second(folder, camera, pentagon):
    """At ten frames per second; another one is not looked for while the first one is where it was."""
    rotation, optics, away = POSES.rotation[0], Optics(noise_grey=0), -0.25
    alone, other = (
        render_view(pentagon, PAPER_CAMERA, rotation, np.array([x, 0, 1.4]), optics, np.random.default_rng(0))
        for x in (away, -away)
    )
    write_video("walk.avi", [alone] * 2 + [np.minimum(alone, other)] * 10, 10.0)
    stream = io.StringIO()
    watch(json=stream)
    assert [len(entry["markers"]) for entry in entries(stream.getvalue())] == [1] * 10 + [2] * 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, BrokenPipeError])
def test_interrupted_in_the_middle(folder, monkeypatch, error):
    honest, count = video.Detector.__call__, iter(range(9))

    def interrupted(detector, image, near=None, deadline=None, whole=False):
        if next(count) == 3:
            raise error
        return honest(detector, image, near, deadline, whole)

    monkeypatch.setattr(video.Detector, "__call__", interrupted)
    output = []
    with pytest.raises(error):
        watch(json="found.jsonl", overlay="seen.mp4", tell=output.append)
    assert len(entries((folder / "found.jsonl").read_text())) == 3
    assert len(read_video("seen.mp4")) == 3
    assert output[-1].startswith("walk.avi: found a marker in 2 of 3 frames")
    assert not [item for item in folder.iterdir() if item.name.startswith(".")]


class FakeWindow:
    """A window that its user closes at the second frame."""

    shown = 0

    def __init__(self, title):
        self.title = title

    @property
    def closed(self):
        return FakeWindow.shown == 2

    def show(self, image):
        FakeWindow.shown += 1

    def close(self):
        pass


def test_closing_the_window_ends_it(folder, monkeypatch):
    monkeypatch.setattr(video, "Window", FakeWindow)
    FakeWindow.shown = 0
    assert watch(window=True).frames == 2
    # Where there is a display, there is a window, unless there is an overlay or none is wanted.
    monkeypatch.setattr(video, "has_display", lambda: True)
    for options, frames in [({}, 2), ({"overlay": "seen.mp4"}, 5), ({"window": False}, 5)]:
        FakeWindow.shown = 0
        assert watch(**options).frames == frames


def test_without_a_display_there_is_no_window(folder, monkeypatch):
    with pytest.raises(InputError, match=r"a display for a window, found none; give --overlay out.mp4"):
        watch(window=True, json="found.jsonl")
    assert not (folder / "found.jsonl").exists()
    # One that does not open is told, and is no reason to stop.
    monkeypatch.setattr(video, "has_display", lambda: True)
    warned = []
    assert watch(warn=warned.append).frames == 5
    assert [item.partition(";")[0] for item in warned] == ["no window: expected a display for a window, found none"]


def test_a_video_whose_end_is_missing_is_told(folder, camera, frames, monkeypatch):
    plugged = camera(frames)
    monkeypatch.setattr(plugged, "get", lambda prop: 9.0 if prop == cv2.CAP_PROP_FRAME_COUNT else 0.0)
    warned, output = [], []
    watch("walk.avi", warn=warned.append, tell=output.append, overlay="seen.avi")
    assert warned == ["walk.avi: 5 of the 9 frames that it states could be read"]
    assert "the frame rate is unknown: seen.avi plays 25 frames per second" in output[-1] + output[-2]


def test_a_disk_that_is_full(folder, monkeypatch):
    """OpenCV writes on without a word; what is missing shows at the end."""
    (folder / "seen.mp4").write_bytes(b"before")
    honest = cv2.VideoWriter.release

    class Full:
        def __init__(self, path, *rest):
            self.path, self.writer = path, VIDEO_WRITER(path, *rest)

        def isOpened(self):
            return True

        def write(self, image):
            self.writer.write(image)

        def release(self):
            honest(self.writer)
            os.truncate(self.path, 3000)

    monkeypatch.setattr(cv2, "VideoWriter", Full)
    Full.fourcc = staticmethod(VIDEO_WRITER.fourcc)
    with pytest.raises(
        OutputError, match=r"expected to write 5 frames to seen.mp4, found 0 in it; nothing was changed"
    ):
        watch(overlay="seen.mp4")
    assert (folder / "seen.mp4").read_bytes() == b"before"
    assert not [item for item in folder.iterdir() if item.name.startswith(".")]
    monkeypatch.setattr(cv2, "VideoWriter", VIDEO_WRITER)
    monkeypatch.setattr(video.shutil, "disk_usage", lambda path: SimpleNamespace(free=19e6))
    with pytest.raises(OutputError, match=r"for seen.mp4, found 19 MB; it ends at frame 0, and later ones were not"):
        watch(overlay="seen.mp4")
    # What there is has its end.
    assert len(read_video("seen.mp4")) == 1
    with pytest.raises(OutputError, match="expected to write /dev/full, found: No space left on device at frame 0"):
        watch(json="/dev/full")


class NearlyFull(io.FileIO):
    """A file that takes the first line and half of the second one, and all that comes after its failure."""

    written = 0

    def write(self, data):
        self.written += 1
        if self.written == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(data if self.written != 2 else data[: len(data) // 2])


def test_a_line_that_does_not_fit_leaves_the_others_whole(folder, monkeypatch):
    whole = Path.open

    def nearly_full(path, mode="r", **options):
        if mode == "w":
            return io.TextIOWrapper(io.BufferedWriter(NearlyFull(path, mode)), **options)
        return whole(path, mode, **options)

    monkeypatch.setattr(Path, "open", nearly_full)
    with pytest.raises(OutputError, match=r"write found.jsonl, found: No space left on device at frame 1; it has all"):
        watch(json="found.jsonl")
    assert [entry["frame"] for entry in entries((folder / "found.jsonl").read_text())] == [0]


def test_what_ends_early_is_counted_against_the_whole():
    assert "of" not in str(Watched("walk", 5, 2, count=5)).partition("2 of 5 frames, ")[2]
    assert "found a marker in 2 of 5 frames, the first of 20, " in str(Watched("walk", 5, 2, count=20))


@pytest.mark.parametrize("rate", [23.976, 59.94, 90.1234, 239.7312, 333.333, 959.04, 1000])
def test_rates_of_fast_cameras_are_written(folder, frames, rate):
    """MPEG-4 has 16 bits for the rate's numerator."""
    with video._Overlay(folder / "seen.mp4", SimpleNamespace(live=False, rate=rate), lambda line: None) as overlay:
        overlay.put(SimpleNamespace(drawn=np.zeros((48, 64, 3), np.uint8), watched=Watched("walk", 1)))
    assert cv2.VideoCapture(str(folder / "seen.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(rate, rel=2e-4)


@pytest.mark.parametrize("suffix", video.CODECS)
def test_every_format_has_the_same_bytes_again(folder, suffix):
    written = []
    for name in ("one", "other"):
        path = folder / f"{name}{suffix}"
        with video._Overlay(path, SimpleNamespace(live=False, rate=25.0), lambda line: None) as overlay:
            overlay.put(SimpleNamespace(drawn=np.zeros((48, 64, 3), np.uint8), watched=Watched("walk", 1)))
        written.append(path.read_bytes())
    assert written[0] == written[1]


def test_a_camera_faster_than_its_overlay_plays_as_fast_as_it_was(folder):
    """100 frames per second, of which it states nothing; 25 are written."""
    camera = SimpleNamespace(live=True, rate=None, notes=[])
    with video._Overlay(folder / "seen.avi", camera, lambda line: None) as overlay:
        for k in range(101):
            look = SimpleNamespace(frame=SimpleNamespace(time=k / 100), watched=Watched("camera 0", k + 1))
            look.drawn = np.full((48, 64, 3), k, np.uint8)
            overlay.put(look)
    levels = [item.mean() for item in read_video("seen.avi")]
    # Half an interval is two levels, and the codec loses as many.
    np.testing.assert_allclose(levels, np.arange(26) * 4, atol=4)


VIDEO_WRITER = cv2.VideoWriter


def test_what_cannot_begin_is_refused(folder, tmp_path):
    for source, options, message in [
        (["a.png", "walk.avi", "0"], {}, "one video, camera or stream at a time, found walk.avi and 2 more"),
        ([], {}, "one video, camera or stream at a time, found none"),
        ("walk.avi", {"workers": 2}, "images for --workers"),
        ("walk.avi", {"smooth": "fast"}, "two positive accelerations"),
        ("walk.avi", {"readout": "30ms"}, "a filter for --readout"),
        ("walk.avi", {"smooth": "2,10", "readout": "-30ms"}, "a readout time"),
        (
            "walk.avi",
            {"overlay": "seen"},
            "a name for a video that ends in .mp4, .m4v, .mov or .avi, found seen; give --overlay seen.mp4",
        ),
        ("walk.avi", {"json": "found.csv"}, "a name for JSON, found found.csv; give --json found.json"),
        ("walk.avi", {"overlay": "walk.avi"}, "one of the inputs"),
        ("walk.avi", {"overlay": "no/such/seen.mp4"}, "the folder no/such does not exist"),
        ("walk.avi", {"json": "marker.json"}, "one of the inputs"),
        ("none.avi", {}, "no such file"),
        ("walk.avi", {"symmetric": "magic"}, "none or any"),
    ]:
        with pytest.raises((InputError, OutputError)) as caught:
            watch(source, **options)
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
    write_video("small.avi", [np.zeros((48, 64), np.uint8)])
    with pytest.raises(InputError, match="640x480 px, found 64x48 px"):
        watch("small.avi", json="found.jsonl", overlay="seen.mp4")
    assert sorted(item.name for item in folder.iterdir()) == ["marker.json", "small.avi", "walk.avi"]


def test_frames_that_change_their_size(folder, camera, frames):
    camera([frames[0], frames[0][:240]])
    assert detect_video("walk.avi", "marker.json").frames == 2
    camera([frames[0], frames[0][:240]])
    with pytest.raises(InputError, match="frames of 640x480 px, as the first one, found 640x240 px"):
        detect_video("walk.avi", "marker.json", overlay="seen.mp4")
    assert len(read_video("seen.mp4")) == 1
