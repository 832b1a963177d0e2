"""The window for videos, on a display that nobody sees."""

import subprocess
import sys
from importlib.util import find_spec
from shutil import which

import pytest

from markergen.detect.presentation import Window, has_display
from markergen.errors import InputError

SCRIPT = """
import numpy as np
from markergen.detect import presentation

assert presentation.has_display()
image = np.zeros((900, 1600, 3), np.uint8)
image[:, :, 2] = 255
for key in ("<Key-q>", "<Key-Escape>"):
    shown = presentation.Window("a video")
    shown.show(image)
    photo = shown._photo
    # As large as nine tenths of the screen allow, and red, which is last in OpenCV's order.
    assert (photo.width(), photo.height()) == (720, 405), (photo.width(), photo.height())
    assert photo.get(10, 10) == (255, 0, 0)
    # The next one comes too soon.
    shown.show(image)
    assert shown._photo is photo and not shown.closed
    shown._root.event_generate(key)
    shown.show(image)
    assert shown.closed
    shown.close()
print("fine")
"""


@pytest.mark.skipif(not which("xvfb-run"), reason="needs a display without a screen: xvfb-run")
@pytest.mark.skipif(not find_spec("tkinter"), reason="needs a Python with Tk")
def test_a_window_shows_frames_until_a_key_closes_it():
    command = ["xvfb-run", "-a", "-s", "-screen 0 800x600x24", sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "fine\n", "")


def test_without_a_display_or_tk_it_says_what_to_do(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    assert not has_display()
    with pytest.raises(InputError, match=r"display for a window, .* --overlay out\.mp4"):
        Window("a video")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setitem(sys.modules, "tkinter", None)
    with pytest.raises(InputError, match=r"for a window, found none \(python3-tk\)"):
        Window("a video")
