"""Three questions make a page."""

from markergen.cli import asked


def test_answers_make_a_command(monkeypatch, capsys):
    answers = iter(["A4 paper", "letter", "webcm", "1280x720@60", "phone", "0.5..2", "0", "2m"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    phrase = asked()
    cone = "cone:distance=0.8..2m,tilt=0..70"
    assert phrase == ["design", "--paper", "letter", "--camera", "phone", "--poses", cone, "-o", "marker.pdf"]
    *refusals, command = capsys.readouterr().out.splitlines()
    refused = ["A4 paper", "webcm", "1280x720@60", "0.5..2", "distance=0"]
    assert [answer in line for answer, line in zip(refused, refusals, strict=True)] == [True] * 5
    assert command.startswith("markergen design --paper letter")


def test_without_answers_it_is_the_usual_design(monkeypatch):
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    monkeypatch.setattr("builtins.input", lambda _: "")
    assert asked() == ["design", "--paper", "A4", "-o", "marker.pdf"]
