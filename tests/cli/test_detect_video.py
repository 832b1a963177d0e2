"""`markergen detect` on a video: what is printed where, and how it ends."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from sentences import sentence
from videos import read_video, write_video

from markergen.cli import console, main
from markergen.model.body_json import to_json
from markergen.model.camera import PAPER_CAMERA
from markergen.model.poses import paper
from markergen.render import Optics, render_view

POSES = paper()
CAMERA_INFO = """\
image_width: 640
image_height: 480
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [800, 0, 320, 0, 800, 240, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
ALL = ["--marker", "marker.json", "--camera", "camera.yaml"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pentagon):
    folder = tmp_path_factory.mktemp("videos")
    (folder / "marker.json").write_bytes(to_json(pentagon))
    (folder / "camera.yaml").write_text(CAMERA_INFO)
    pose = POSES.rotation[130], POSES.translation[130]
    frame = render_view(pentagon, PAPER_CAMERA, *pose, Optics(), np.random.default_rng(0))
    write_video(folder / "walk.mp4", [frame] * 3, code="mp4v")
    write_video(folder / "away.avi", [frame, 0 * frame + 200])
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.delenv("DISPLAY", raising=False)
    return folder


def test_a_video_with_its_outputs(here, capsys, tmp_path):
    path, seen = tmp_path / "found.jsonl", tmp_path / "seen.mp4"
    arguments = ["--json", str(path), "--overlay", str(seen), "--smooth", "2,10"]
    assert main(["detect", "walk.mp4", *ALL, *arguments]) == 0
    output = capsys.readouterr()
    assert not output.err
    *written, last = output.out.splitlines()
    assert sorted(written) == [f"wrote {path}", f"wrote {seen}"]
    assert last.startswith(f"walk.mp4: {sentence('markers found', '3 of 3 frames')}, ")
    assert last.endswith(" 0 dropped")
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for number, line in enumerate(lines):
        assert (line["frame"], line["dropped"], line["clock"]) == (number, 0, None)
        (entry,) = line["markers"]
        for pose in (entry["pose"], entry["smoothed"]):
            # A video's coding costs a hundredth of a pixel or two.
            np.testing.assert_allclose(pose["translation"], POSES.translation[130], atol=2e-3)
    assert len(read_video(seen)) == 3


def test_standard_output_is_lines_of_json_alone(here, capsys):
    assert main(["detect", "away.avi", *ALL, "--json", "-"]) == 1
    output = capsys.readouterr()
    assert [json.loads(line)["markers"][0]["found"] for line in output.out.splitlines()] == [True, False]
    assert output.err.startswith(f"away.avi: {sentence('markers found', '1 of 2 frames')}")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["walk.mp4", "away.avi", *ALL], "one video, camera or stream at a time"),
        (["walk.mp4", "photo.png", *ALL], "one video, camera or stream at a time"),
        (["977", *ALL], "a camera 977, found none that opens"),
        (["none.mp4", *ALL], "no such file"),
        (["walk.mp4", *ALL, "--overlay", "seen"], "a name for a video"),
        (["walk.mp4", *ALL, "--window"], "a display for a window"),
        (["walk.mp4", *ALL, "--smooth", "2"], "give --smooth 2,10"),
        (["walk.mp4", "--marker", "marker.json", "--smooth", "2,10"], "a camera for --smooth, found none"),
        (["photo.png", *ALL, "--smooth", "2,10"], "a video or camera for --smooth, found images"),
        (["photo.png", *ALL, "--window"], "a video or camera for --window, found images"),
        (["photo.png", *ALL, "--overlay", "seen.mp4"], "a folder for overlays of images"),
    ],
)
def test_bad_input_is_one_line_and_status_2(here, capsys, arguments, message):
    before = sorted(item.name for item in here.iterdir())
    assert main(["detect", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("markergen: error: ")
    assert len(error.strip().splitlines()) == 1
    assert message in error
    assert sorted(item.name for item in here.iterdir()) == before


def test_ctrl_c_leaves_complete_outputs(here, tmp_path):
    """In a named pipe with a video whose end does not come."""
    pipe, seen = tmp_path / "live.avi", tmp_path / "seen.mp4"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "markergen", "detect", str(pipe), *ALL, "--json", "-", "--overlay", str(seen)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **streams, cwd=here, env=environment) as running:
        with pipe.open("wb") as stream:
            stream.write((here / "away.avi").read_bytes())
            stream.flush()
            # Each line comes at once.
            finding = [json.loads(running.stdout.readline())["markers"][0]["found"] for _ in range(2)]
            running.send_signal(signal.SIGINT)
            running.wait(30)
        rest, message = running.communicate()
    assert (finding, rest, running.returncode) == ([True, False], "", 130)
    wrote, total, *notes, last = message.splitlines()
    assert wrote == f"wrote {seen}"
    assert total.startswith(f"{pipe}: {sentence('markers found', '1 of 2 frames')}")
    assert not notes
    assert last == "markergen: error: interrupted"
    assert len(read_video(seen)) in (1, 2)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["live.avi", "seen.mp4"]


def test_a_terminal_shows_one_line_that_changes(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    for name, value in {"COLUMNS": "60", "TERM": "xterm", "NO_COLOR": "1"}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    with console.status_line("waiting for a frame") as show:
        show("0.04 s, [12] frames per second; " + 10 * "marker.json, ")
        time.sleep(0.2)
        print("the sum")
    # A file or a pipe has what is printed meanwhile; a terminal has it above that line.
    assert sys.stdout.getvalue() == "the sum\n"
    assert "the sum" not in sys.stderr.getvalue()
    printed = sys.stderr.getvalue()
    assert "0.04 s, [12] frames per second; marker.json" in printed
    assert max(len(line) for line in re.split(r"\x1b\[[0-9?;]*[A-Za-z]|[\r\n]", printed)) <= 60
    assert printed.count("\n") == 1
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with console.status_line("waiting for a frame") as show:
        show("a log has no such lines")
    assert sys.stderr.getvalue() == ""
