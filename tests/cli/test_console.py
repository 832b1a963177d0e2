"""Progress in a log."""

from types import SimpleNamespace

import pytest

from markergen.cli import console


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(console, "monotonic", lambda: clock.now)
    return clock


def test_a_log_gets_a_line_now_and_then(clock, capsys):
    with console.progress_bar() as progress:
        for clock.now in range(0, 100, 10):
            progress("descent", int(clock.now), 100)
    assert capsys.readouterr().err.splitlines() == ["moving dots downhill, 40 %", "moving dots downhill, 80 %"]


def test_a_log_of_a_study_begins_at_once_and_has_the_end(clock, capsys):
    with console.cells_progress() as progress:
        for clock.now in range(5):
            progress(int(clock.now), 4, float("nan"))
    assert capsys.readouterr().err.splitlines() == ["0 of 4 cells", "4 of 4 cells"]
