import importlib.util
import subprocess
import sys

import pytest

from markergen.drawing import text as module
from markergen.drawing.scene import bounds
from markergen.drawing.text import text, text_width, wrap
from markergen.errors import MissingLibraryError


def test_capital_has_the_height_asked_for_and_stands_on_the_baseline():
    left, bottom, right, top = bounds(text("H", 10, 20, 5))
    # Points are font units times a scale: only rounding of doubles.
    assert bottom == pytest.approx(20, abs=1e-9)
    assert top == pytest.approx(25, abs=1e-9)
    assert 10 < left < right < 10 + text_width("H", 5)


@pytest.mark.parametrize(("align", "offset"), [("left", 0), ("center", -0.5), ("right", -1)])
def test_alignment_shifts_by_the_width(align, offset):
    width = text_width("Marker", 2)
    plain, aligned = bounds(text("Marker", 0, 0, 2)), bounds(text("Marker", 0, 0, 2, align))
    assert aligned[0] - plain[0] == pytest.approx(offset * width, abs=1e-9)


def test_width_adds_up_and_scales():
    assert text_width("ab", 2) == pytest.approx(text_width("a", 2) + text_width("b", 2))
    assert text_width("ab", 4) == pytest.approx(2 * text_width("ab", 2))
    assert text_width("", 2) == 0
    assert text_width("print", 2, "bold") > text_width("print", 2)


def test_every_printable_latin_1_letter_has_an_outline_and_others_become_question_marks():
    blank = {" ", "\xa0", "\xad"}
    for code in [*range(0x21, 0x7F), *range(0xA1, 0x100)]:
        if chr(code) not in blank:
            assert text(chr(code), 0, 0, 2).segments, chr(code)
    assert text("\u4e2d", 0, 0, 2) == text("?", 0, 0, 2)


def test_contours_are_closed_and_of_known_steps():
    sizes = {"M": 1, "L": 1, "Q": 2, "C": 3, "Z": 0}
    segments = text("éß8", 0, 0, 2).segments
    assert all(len(points) == sizes[command] for command, points in segments)
    commands = "".join(command for command, _ in segments)
    assert commands.count("M") == commands.count("Z") == 7  # e 2, accent 1, eszett 1, eight 3
    assert commands.endswith("Z")


def test_wrap_keeps_words_and_width():
    sentence = "This ruler must measure 200 mm and nothing else"
    lines = wrap(sentence, 30, 2)
    assert len(lines) > 1
    assert " ".join(lines) == sentence
    assert all(text_width(line, 2) <= 30 for line in lines)
    assert wrap("incompressible", 1, 2) == ["incompressible"]


def test_a_missing_font_says_what_to_install(monkeypatch):
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    with pytest.raises(MissingLibraryError, match="pip install"):
        module._font_file("Vera.ttf")


def test_finding_the_font_does_not_import_reportlab():
    assert importlib.util.find_spec("reportlab") is not None
    code = "import sys; from markergen.drawing.text import text; text('x', 0, 0, 1); print('reportlab' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
