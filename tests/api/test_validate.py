import inspect
import json
import logging
import math
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from markergen.api import validate as module
from markergen.api.validate import validate
from markergen.errors import InputError, MissingLibraryError, OutputError
from markergen.model.body_json import to_json
from markergen.model.camera import PAPER_CAMERA, Camera
from markergen.model.poses import named_poses
from markergen.options import declared
from markergen.options.declarations import ValidateKeywords
from markergen.validation.report.plots import errors_over
from markergen.validation.result import Validation

FAST = {"poses": "cone:count=20", "runs": 0, "views": 0, "workers": 1}
FILES = ("r.html", "r.json", "r.svg", "r.png")


@pytest.fixture(scope="module")
def bounds(pentagon):
    """A validation without trials and views."""
    return validate(pentagon, **FAST)


def test_the_results_are_those_of_the_json(proved, pentagon):
    result = proved.found
    assert json.loads(result.to_json()) == dict(result.results)
    assert result.marker is pentagon
    assert result.setting.camera == PAPER_CAMERA
    assert len(result.setting.poses) == result.results["poses"]["count"] == 20
    assert result.bound["rotation_deg"] == result.results["bound"]["rotation_deg"] > 0
    assert result.estimators["lm"]["rotation_deg"]["count"] == 400
    assert result.views["count"] == 4
    assert result.nees["count"] > 0
    assert result.budget["rotation_deg"]["total"] >= result.budget["rotation_deg"]["print"]
    assert {stage for stage, _, _ in proved.calls} == {"trials", "views"}
    with pytest.raises(TypeError):
        result.results["runs"] = 3


def test_without_trials_and_views_there_are_bounds(bounds):
    assert dict(bounds.estimators) == {}
    assert bounds.views is None
    assert bounds.nees is None
    assert bounds.bound["translation_pct"] > 0
    assert bounds.written == ()


def test_markers_cameras_and_poses_in_every_form(bounds, pentagon, tmp_path):
    path = tmp_path / "marker.json"
    path.write_bytes(to_json(pentagon))
    camera = tmp_path / "camera.yaml"
    camera.write_text("width: 640\nheight: 480\nfx: 800\nfy: 800\ncx: 320\ncy: 240\n")
    forms = [
        (path, PAPER_CAMERA, named_poses("cone:count=20")),
        (str(path), str(camera), "cone:count=20"),
        (json.loads(path.read_text()), camera, "cone:count=20"),
        (pentagon, PAPER_CAMERA.as_dict(), "cone:count=20"),
    ]
    for marker, seen, poses in forms:
        assert dict(validate(marker, seen, **{**FAST, "poses": poses}).bound) == dict(bounds.bound)
    wider = validate(pentagon, replace(PAPER_CAMERA, fx=400.0, fy=400.0), **FAST)
    assert wider.bound["rotation_deg"] > 1.5 * bounds.bound["rotation_deg"]


def test_poses_of_a_file(pentagon, tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("tx,ty,tz,qx,qy,qz,qw\n0,0,1,1,0,0,0\n0,0,2,1,0,0,0\n")
    results = [validate(pentagon, **{**FAST, "poses": poses}) for poses in (path, str(path))]
    assert [item.results["poses"]["count"] for item in results] == [2, 2]


def test_numbers_of_numpy_and_lengths_are_read(pentagon, bounds):
    validation = validate(pentagon, **{**FAST, "runs": np.int64(0)}, print_sigma="0.2mm", noise=np.float32(0.4))
    assert validation.budget["print_sigma_mm"] == pytest.approx(0.2)
    assert validation.bound["rotation_deg"] == pytest.approx(2 * bounds.bound["rotation_deg"])


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((3,), {}, "dict of marker.json, found int 3"),
        ((None,), {}, "dict of marker.json"),
        (("none.json",), {}, "none.json"),
        (({"version": 1},), {}, "in the dict, found another kind of file"),
        ((..., 5), {}, "found int 5"),
        ((..., "none.yaml"), {}, "none.yaml"),
        ((...,), {"runs": "many"}, "runs='many' (a whole number)"),
        ((...,), {"rnus": 3}, "did you mean 'runs'?"),
        ((...,), {"runs": True}, "runs=True"),
        ((...,), {"runs": -1}, "runs"),
        ((...,), {"noise": math.nan}, "noise"),
        ((...,), {"poses": 5}, "poses=5"),
        ((...,), {"poses": "pepper"}, "pose distribution"),
        ((...,), {"poses": object()}, "poses"),
        ((...,), {"optics": "zzz=1"}, "blur_px"),
        ((...,), {"views": 0, "stress": True}, "stress"),
        ((...,), {"views": 0, "pictures": "p"}, "views to take"),
        ((...,), {"save": "r.pdf"}, ".html"),
        ((...,), {"save": 3}, "a path"),
        ((...,), {"report": "r.json"}, ".html"),
        ((...,), {"progress": 3}, "a function for progress, found 3"),
        ((...,), {"json": 3}, "a path for json"),
        ((...,), {"camera_covariance": "none.txt"}, "none.txt"),
    ],
)
def test_bad_input_is_our_own_error_in_one_line(arguments, options, message, pentagon, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    stated = [pentagon if argument is ... else argument for argument in arguments]
    with pytest.raises(InputError) as caught:
        validate(*stated, **{**FAST, **options})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_the_covariance_in_the_file_of_the_camera_is_counted(pentagon, tmp_path):
    path, stated = tmp_path / "camera.toml", tmp_path / "sigmas.txt"
    PAPER_CAMERA.save(path, [2, 2, 1.5, 1.5])
    stated.write_text("2 2 1.5 1.5")
    few = FAST | {"poses": "cone:count=4"}
    results = validate(pentagon, path, **few).results["budget"]
    assert results == validate(pentagon, PAPER_CAMERA, camera_covariance=stated, **few).results["budget"]
    assert results["rotation_deg"]["camera"] > 0
    assert validate(pentagon, path, camera_covariance="none", **few).results["budget"]["camera_exact"]


def test_saving_nothing_is_refused_and_none_asks_for_nothing(proved, pentagon):
    assert not validate(pentagon, **{**FAST, "save": None}).written
    for nothing in ((), (None,)):
        with pytest.raises(InputError, match=r"a path"):
            proved.found.save(*nothing)


def test_what_cannot_be_written_is_told_before_the_work(pentagon, tmp_path, monkeypatch):
    path = tmp_path / "marker.json"
    path.write_bytes(to_json(pentagon))
    monkeypatch.setattr(module, "run", None)
    for options in (
        {"save": tmp_path / "no" / "r.html"},
        {"save": [tmp_path / "r.html", tmp_path / "r.html"]},
        {"json": path},
        {"json": tmp_path / "r.html", "report": tmp_path / "r.html"},
        {"pictures": path, "views": 1},
    ):
        with pytest.raises(OutputError):
            validate(path, **{**FAST, **options})
    assert list(tmp_path.iterdir()) == [path]


def test_files_by_suffix_and_by_name(proved, pentagon, quick, undrawn, tmp_path):
    validation = validate(
        pentagon, **quick, save=[tmp_path / name for name in FILES],
        json=str(tmp_path / "plain"), pictures=tmp_path / "views",
    )  # fmt: skip
    assert {item.path.name for item in validation.written} == {*FILES, "plain"} | {
        path.name for path in (tmp_path / "views").iterdir()
    }
    assert len(list((tmp_path / "views").iterdir())) == 4
    assert (tmp_path / "r.json").read_bytes() == (tmp_path / "plain").read_bytes() == validation.to_json()
    assert (tmp_path / "r.html").read_bytes().startswith(b"<!DOCTYPE html>")
    assert b"<svg" in (tmp_path / "r.svg").read_bytes()
    assert (tmp_path / "r.png").read_bytes().startswith(b"\x89PNG")
    # Saved later, from another run of the same: the same bytes.
    saved = tmp_path / "saved"
    saved.mkdir()
    proved.found.save(*(saved / name for name in FILES))
    proved.found.save_pictures(saved / "views")
    for path in saved.rglob("*.*"):
        assert path.read_bytes() == (tmp_path / path.relative_to(saved)).read_bytes()


def test_all_files_or_none(proved, tmp_path, monkeypatch):
    def fails(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("markergen.presentation.results.figure_bytes", fails)
    with pytest.raises(OSError):
        proved.found.save(tmp_path / "r.json", tmp_path / "r.svg")
    assert list(tmp_path.iterdir()) == []


def test_pictures_of_an_earlier_run_go_and_other_files_stay(proved, tmp_path):
    for name in ("failure-0099.png", "worst-0099.png", "mine.png"):
        (tmp_path / name).write_bytes(b"before")
    written = proved.found.save_pictures(str(tmp_path))
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {item.path.name for item in written} | {"mine.png"}


def test_printed_it_is_what_the_command_prints(proved, bounds):
    message = str(proved.found)
    for phrase in (
        "Rotation error RE, deg",
        "Error budget",
        "Synthetic views",
        "4 of 4 rendered views detected",
        "bound (CRLB)",
    ):
        assert phrase in message
    tables = [line for line in message.splitlines() if "─" in line]
    assert len(tables) >= 6
    assert max(map(len, tables)) <= 100
    assert "Rotation error RE" not in str(bounds)
    for item in (proved.found, bounds):
        assert len(repr(item)) < 2000
        assert "\n" not in repr(item)
    assert "20 poses x 20 runs, 4 of 4 views" in repr(proved.found)


def test_the_command_prints_it(proved, pentagon, tmp_path, monkeypatch, capsys):
    from markergen.cli import main

    monkeypatch.chdir(tmp_path)
    Path("m.json").write_bytes(to_json(pentagon))
    arguments = ["validate", "m.json", "--poses", "cone:count=20", "--runs", "20", "--views", "4", "--workers", "1"]
    assert main([*arguments, "--details"]) == 0
    assert capsys.readouterr().out == str(proved.found) + "\n"
    assert main(arguments) == 0
    brief = capsys.readouterr().out.splitlines()
    assert len(brief) <= 8
    assert brief[0] == proved.found.brief()[0]


def test_html_shows_tables_and_escapes_what_comes_from_files(proved, pentagon):
    html = proved.found._repr_html_()
    assert html.count("<table>") == html.count("</table>") >= 6
    poses = replace(named_poses("cone:count=20"), name="<script>alert(1)</script>")
    hostile = validate(pentagon, **{**FAST, "poses": poses})._repr_html_()
    assert "<script>" not in hostile
    assert "&lt;script&gt;" in hostile


def test_checks(proved):
    passed, message = proved.found.check("estimators.lm.rotation_deg.rms > 100")
    assert passed
    assert "<= 100" in message
    assert not proved.found.check("bound.rotation_deg > 0")[0]
    for expression in ("nonsense", "bound.nothing > 1", 3, None):
        with pytest.raises(InputError):
            proved.found.check(expression)


def test_rows_for_each_estimator_and_angle(proved, bounds, frames):
    rows = proved.found.to_frame()
    results = proved.found.results
    assert {row["source"] for row in rows} == {"trials", "views"}
    lm = [row for row in rows if row["source"] == "trials" and row["estimator"] == "lm"]
    assert [row["polar_angle_deg"] for row in lm] == ["all", *results["bound"]["by_polar_angle"]]
    assert lm[0]["rotation_deg_rms"] == results["estimators"]["lm"]["rotation_deg"]["rms"]
    assert lm[0]["rotation_deg_bound"] == results["bound"]["rotation_deg"]
    assert lm[0]["efficiency"] == results["estimators"]["lm"]["efficiency"]
    assert lm[1]["translation_pct_bound"] == next(iter(results["bound"]["by_polar_angle"].values()))["translation_pct"]
    assert sum(row["rotation_deg_count"] for row in lm[1:]) == lm[0]["rotation_deg_count"] == 400
    detected = [row for row in rows if row["estimator"] == "detect" and row["polar_angle_deg"] == "all"]
    assert detected[0]["rotation_deg_rms"] == results["views"]["estimators"]["detect"]["rotation_deg"]["rms"]
    assert len({tuple(row) for row in rows}) == 1
    rows = bounds.to_frame()
    assert {row["source"] for row in rows} == {"bound"}
    assert [row["polar_angle_deg"] for row in rows] == ["all", *bounds.bound["by_polar_angle"]]
    assert rows[0]["rotation_deg_bound"] == bounds.bound["rotation_deg"]
    assert rows[0]["rotation_deg_rms"] is None


def test_without_pandas_the_message_says_how_to_get_it(proved, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingLibraryError, match="pip install pandas"):
        proved.found.to_frame()


def test_the_plot_draws_what_was_measured(proved, bounds):
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    assert proved.found.plot(ax) is ax
    labels = ax.get_legend_handles_labels()[1]
    assert {"LM, RMS", "bound (CRLB)"} <= set(labels)
    drawn = dict(zip(labels, ax.get_legend_handles_labels()[0], strict=True))["bound (CRLB)"].get_ydata()
    assert list(drawn) == [row["rotation_deg"] for row in proved.found.bound["by_polar_angle"].values()]
    ours = bounds.plot()
    assert ours.figure.axes == [ours]


def test_without_trials_the_plot_shows_the_views(proved):
    views = dict(proved.found.results) | {"estimators": {}}
    labels = Validation(views, proved.found.series).plot().get_legend_handles_labels()[1]
    assert "detection's own, RMS" in labels
    assert errors_over.__module__.startswith("markergen.validation.report")


def test_it_can_be_sent_to_another_process(proved, tmp_path):
    copy = pickle.loads(pickle.dumps(proved.found))
    assert str(copy) == str(proved.found)
    proved.found.save(tmp_path / "r.svg")
    copy.save(tmp_path / "copy.svg")
    assert (tmp_path / "copy.svg").read_bytes() == (tmp_path / "r.svg").read_bytes()
    assert len(pickle.dumps(proved.found)) < 1_000_000


def test_it_tells_the_log_and_nobody_else(pentagon, caplog, capsys):
    with caplog.at_level(logging.INFO, "markergen"):
        validate(pentagon, **FAST)
    assert [record.name for record in caplog.records] == ["markergen.api.validate"] * 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")


def test_help_lists_every_option():
    names = list(inspect.signature(validate).parameters)
    assert names[:2] == ["marker", "camera"]
    assert set(declared(ValidateKeywords)) <= set(names)


def test_a_camera_that_sees_nothing_is_told(pentagon):
    with pytest.raises(InputError, match="the whole marker"):
        validate(pentagon, Camera(8, 8, 800.0, 800.0, 4.0, 4.0), **FAST)
