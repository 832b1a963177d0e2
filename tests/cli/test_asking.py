"""Three questions make a page."""

from markergen.cli import asked


def test_answers_make_a_command(monkeypatch, capsys):
    answers = iter(["letter", "phone", "0.5..2", "2m"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    words = asked()
    cone = "cone:distance=0.8..2m,tilt=0..70"
    assert words == ["design", "--paper", "letter", "--camera", "phone", "--poses", cone, "-o", "marker.pdf"]
    refused, command = capsys.readouterr().out.splitlines()
    assert "0.5..2" in refused
    assert command.startswith("markergen design --paper letter")


def test_without_answers_it_is_the_usual_design(monkeypatch):
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    monkeypatch.setattr("builtins.input", lambda _: "")
    assert asked() == ["design", "--paper", "A4", "-o", "marker.pdf"]
