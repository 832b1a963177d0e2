import json

import pytest

from markergen.cli import main
from markergen.model.body_json import to_json


@pytest.fixture(scope="module")
def folder(tmp_path_factory, pentagon):
    folder = tmp_path_factory.mktemp("validate")
    (folder / "marker.json").write_bytes(to_json(pentagon))
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


SHORT = ["validate", "marker.json", "--runs", "0", "--poses", "cone:count=20"]


def test_views_report_and_pictures(here, capsys, tmp_path, undrawn):
    report, pictures = tmp_path / "report.html", tmp_path / "pictures"
    pictures.mkdir()
    (pictures / "failure-0099.png").write_bytes(b"of another run")
    (pictures / "mine.png").write_bytes(b"not of any run")
    assert main([*SHORT, "--views", "5", "--report", str(report), "--pictures", str(pictures), "--details"]) == 0
    output = capsys.readouterr().out
    for phrase in ("Error budget", "Synthetic views", "5 of 5 rendered views detected", "print limits"):
        assert phrase in output
    assert report.read_bytes().startswith(b"<!DOCTYPE html>")
    names = {path.name for path in pictures.iterdir()}
    assert "mine.png" in names
    assert "failure-0099.png" not in names
    assert any(name.startswith("worst-") for name in names)


def test_optics_change_the_budget_also_without_views(here):
    plain, blurred = here / "plain.json", here / "blurred.json"
    assert main([*SHORT, "--views", "0", "--json", str(plain)]) == 0
    assert main([*SHORT, "--views", "0", "--optics", "blur_px=3,noise_grey=20", "--json", str(blurred)]) == 0
    image = [json.loads(path.read_text())["budget"]["rotation_deg"]["image"] for path in (plain, blurred)]
    # Information falls with the blur's width and the square of the noise: by 4 and by 100.
    assert image[1] / image[0] == pytest.approx(20, rel=0.2)


def test_nothing_found_fails_a_check_and_loses_nothing(here, capsys, tmp_path):
    path = tmp_path / "found.json"
    check = "views.estimators.detect.rotation_deg.rms > 1"
    assert main([*SHORT, "--views", "3", "--hide", "5", "--json", str(path), "--fail-if", check]) == 1
    assert "no value" in capsys.readouterr().err
    assert json.loads(path.read_text())["views"]["detected"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--views", "0", "--stress"], "--stress"),
        (["--views", "0", "--pictures", "p"], "--pictures"),
        (["--views", "0", "--optics", "zzz=1"], "blur_px"),
        (["--views", "0", "--background", "fog"], "clutter"),
        (["--views", "1000000000"], "1000000 views"),
        (["--views", "-1"], "0 to"),
        (["--views", "1", "--optics", "noise_grey=1e308"], "noise_grey"),
        (["--views", "1", "--hide", "9"], "hidden"),
        (["--views", "1", "--report", "r.pdf"], ".html"),
        (["--views", "1", "--report", "r.html", "--json", "r.html"], "asked for twice"),
        (["--views", "1", "--json", "marker.json"], "one of the inputs"),
        (["--views", "1", "--pictures", "marker.json"], "Not a directory"),
        (["--views", "1", "--workers", "100000"], "workers"),
        (["--views", "1", "--camera-covariance", "none.txt"], "none.txt"),
        (["--views", "1", "--print-sigma", "-1mm"], "print"),
    ],
)
def test_bad_input_is_one_line_and_status_2(here, capsys, options, message):
    before = (here / "marker.json").read_bytes()
    assert main([*SHORT, *options]) == 2
    error = capsys.readouterr().err
    assert error.startswith("markergen: error: ")
    assert len(error.strip().splitlines()) == 1
    assert message in error
    assert (here / "marker.json").read_bytes() == before
