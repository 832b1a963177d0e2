"""The command line as a user meets it: the main job from end to end, and what it says when something is wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from markergen import __version__
from markergen.cli import main
from markergen.model.body_json import to_json

FEW = ["--restarts", "1", "--poses", "cone:count=8"]
"""Options that make a design quick."""
SMALL = "validate marker.json --poses cone:count=20 --views 0 --workers 1"


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def marker(here, pentagon) -> Path:
    (here / "marker.json").write_bytes(to_json(pentagon))
    return here / "marker.json"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def complaint(capsys, *arguments) -> str:
    """Status 2, and one line on stderr that is the whole answer."""
    assert main([str(argument) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    lines = captured.err.splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("markergen: error: ")
    assert "Traceback" not in captured.err
    return lines[0]


@pytest.mark.parametrize("command", [["design", "-o", "a.json"], ["templates"], ["--version"]])
def test_a_closed_standard_output_is_told(here, capsys, monkeypatch, command):
    monkeypatch.setattr("sys.stdout", None)
    assert main(command) == 2
    assert "found it closed" in capsys.readouterr().err
    assert names(here) == set()


def test_the_main_job(here, capsys):
    files = ["-o", "marker.pdf", "-o", "marker.svg"]
    assert main(["design", "--n", "5", "--radius", "0.15", "--restarts", "1", *files, "--details"]) == 0
    output = capsys.readouterr().out
    assert names(here) == {"marker.pdf", "marker.svg", "marker.json"}
    for phrase in (
        "5 control points in a disk of radius 150 mm",
        "36 mm",
        "needs A2",
        "regular 5-gon",
        "random, median",
    ):
        assert phrase in output
    assert main(["validate", "marker.json", "--runs", "1", "--views", "2", "--json", "results.json", "--details"]) == 0
    output = capsys.readouterr().out
    for phrase in ("EPnP", "IPPE", "LM", "SQPnP", "DLT", "bound (CRLB)", "70 deg", "2 of 2 rendered views detected"):
        assert phrase in output
    results = json.loads((here / "results.json").read_text())
    assert set(results) == {
        "marker", "criteria", "comparisons", "nees", "camera", "poses", "noise_px", "runs", "seed", "condition",
        "homography", "estimators", "bound", "budget", "labels", "views", "dots",
        "expected", "headline", "relative_error",
    }  # fmt: skip
    assert set(results["comparisons"]) == {"ngon", "square", "random"}
    assert set(results["estimators"]) == {"epnp", "ippe", "lm", "sqpnp"}
    assert main(["export", "marker.json", "-o", "copy.svg", "--paper", "A1"]) == 0
    assert "A1" not in capsys.readouterr().err


@pytest.mark.long
def test_the_same_seed_writes_the_same_bytes(here):
    for folder in ("a", "b"):
        (here / folder).mkdir()
        outputs = ["-o", f"{folder}/m.pdf", "-o", f"{folder}/m.svg"]
        assert main(["design", "--n", "4", "--seed", "3", "--restarts", "2", *outputs]) == 0
    for name in ("m.pdf", "m.svg", "m.json"):
        assert (here / "a" / name).read_bytes() == (here / "b" / name).read_bytes()


def test_options_go_before_the_template(here, capsys):
    assert main(["design", "--template", "desk-a4", "--n", "4", *FEW, "-o", "m.json"]) == 0
    assert "4 control points in a disk" in capsys.readouterr().out
    assert names(here) == {"m.json"}


def test_the_desk_template_fits_on_a4(here, capsys):
    assert main(["design", "--template", "desk-a4", *FEW, "-o", "m.pdf"]) == 0
    assert "needs A4" in capsys.readouterr().out


def test_templates_are_listed_and_printed(capsys):
    assert main(["templates"]) == 0
    assert "desk-a4" in capsys.readouterr().out
    assert main(["templates", "paper-disk"]) == 0
    assert 'radius = "150mm"' in capsys.readouterr().out


def test_no_arguments_is_a_cry_for_help(capsys):
    assert main([]) == 0
    assert "Commands:" in capsys.readouterr().out


def test_the_record_is_known_by_its_place_not_its_spelling(here, capsys):
    (here / "a").mkdir()
    assert main(["design", "--n", "4", *FEW, "-o", "a/../p.svg", "-o", "p.json"]) == 0
    assert names(here) == {"a", "p.svg", "p.json"}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param("--help", marks=pytest.mark.long),
        pytest.param("templates", marks=pytest.mark.long),
        "export marker.json -o m.svg",
    ],
)
def test_a_full_standard_output_is_one_line(marker, arguments):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [sys.executable, "-m", "markergen", *arguments.split()],
            cwd=marker.parent, env=environment, stdout=full, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    assert run.returncode == 2
    assert run.stderr.startswith("markergen: error: ")
    assert "No space left" in run.stderr
    assert "Traceback" not in run.stderr


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"markergen {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        ("design --n 3", "at least 4 control points, found n=3"),
        ("design --n four", "--n"),
        ("design --radius 0", "radius above 0"),
        ("design --radius -0.1", "radius above 0"),
        ("design --radius nan", "finite"),
        ("design --radius wide", "'--radius': expected a length"),
        ("design --dot 5xx", "a number and one of m, cm, mm"),
        ("design --noise-model point --print-sigma 0.1mm", "use --noise-model image"),
        ("design --dot auto --print-sigma -1mm", "a print error of 0 or more"),
        ("design --n 201", "at most 200"),
        ("design --n 99999999999999999999", "n: "),
        ("design --restarts 0", "--restarts"),
        ("design --radius 4um -o m.json", "room for dots of 0.1 mm"),
        ("design --clearance 149mm -o m.json", "with a clearance of 149 mm; use a larger marker, a smaller --n or a s"),
        ("design --coordinates metric", "only --objective condition"),
        ("design -o /", "name a file in it, such as /marker.json"),
        ("design -o .", "name a file in it, such as marker.json"),
        ("design -o a/../m.pdf -o ./m.pdf", "twice"),
        ("design --radius 0.15 --n 12 --dot 80mm", "of which 8 fit"),
        ("design --n 5 --dot 500mm", "of which 0 fit"),
        ("design --thickness 0 -o m.json", "--thickness from 0.01 mm"),
        ("design --corner-radius -3mm -o m.json", "--corner-radius from 0 mm"),
        ("design --poses 0.4-0.8m -o m.json", "cone:distance"),
        ("design --camera 5MP -o m.json", "webcam, phone"),
        ("design --objective speed", "known: blunder, condition, homography, pose"),
        ("design --objective pos", "did you mean 'pose'?"),
        ("design --aggregate median", "nown: cvar, logmean, max, mean, rms"),
        ("design --coordinates polar --objective condition", "unit, metric, pixel, hartley"),
        ("design --poses sideways", "known: paper, paper-roll"),
        ("design --template none", "known: conveyor, cube, desk-a4, desk-letter"),
        ("design --radius 3 -o m.json", "none of 400"),
        ("design -o marker.doc", ".pdf"),
        ("design -o marker", ".pdf"),
        ("design -o a.pdf -o a.pdf", "twice"),
        ("design -o none/marker.pdf", "the folder none does not exist"),
        ("design --radius 0.15 --restarts 1 -o m.pdf --paper A3 --no-tile", "A2"),
        ("design -o m.pdf --paper A99", "A0"),
        ("design --restarts 1 --dot 0 -o m.pdf", "dot"),
        ("design --seed -1", "seed"),
        ("design --seed one", "'--seed': expected a whole number, found 'one'"),
        ("design --asymmetric wide", "'--asymmetric': expected a number, found 'wide'"),
        ("studio --port one", "'--port': expected a whole number, found 'one'"),
        ("design --camera phones", "did you mean 'phone'?"),
        ("design --dot auto --gap 5 -o m.json", "with a gap of 5 m"),
        ("rig wall -o m.json", "found no number"),
        ("design --color red", "--color"),
        ("draw", "draw"),
        ("export none.json -o m.svg", "No such file"),
        ("validate none.json", "No such file"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(here, capsys, arguments, phrase):
    assert phrase in complaint(capsys, *arguments.split())
    assert names(here) == set()


@pytest.mark.parametrize(
    ("arguments", "phrase"),
    [
        ("validate marker.json --runs -1", "runs"),
        ("validate marker.json --noise -0.1", "noise"),
        ("validate marker.json --noise nan", "noise"),
        ("validate marker.json --workers 0", "worker"),
        ("validate marker.json --views -2 --runs 0", "view"),
        ("validate marker.json --poses none", "Known: paper, paper-roll"),
        ("validate marker.json --runs 1 --fail-if nonsense", "write for example"),
        (f"{SMALL} --runs 1 --fail-if estimators.pnp.rotation_deg.rms>1", "epnp"),
        ("validate marker.json --json none/r.json", "the folder none does not exist"),
        ("validate marker.json --fail-if a>", "write for example"),
        (f"{SMALL} --runs 0 --fail-if estimators.lm.rotation_deg.rms>1", "ask for them with --runs"),
        ("validate marker.json --noise 1e300", "noise"),
        ("export marker.json -o m.xyz", ".step"),
        ("export marker.json", "-o"),
        ("export marker.json -o marker.json -o none/m.svg", "the folder none does not exist"),
    ],
)
def test_bad_requests_leave_the_marker_alone(marker, capsys, arguments, phrase):
    before = marker.read_bytes()
    status = main(arguments.split())
    captured = capsys.readouterr()
    assert status == 2
    assert len(captured.err.splitlines()) == 1
    assert phrase in captured.err
    assert marker.read_bytes() == before
    assert names(marker.parent) == {"marker.json"}


@pytest.mark.parametrize("command", ["validate marker.json --runs 1", "export marker.json -o m.svg"])
@pytest.mark.parametrize("damage", ["cut", "foreign", "newer", "twice", "outside"])
def test_a_bad_marker_is_refused_by_every_reader(marker, capsys, command, damage):
    content = json.loads(marker.read_text())
    phrase = {
        "cut": "complete JSON", "foreign": "another kind of file", "newer": "version 3", "twice": "used twice",
        "outside": "over the boundary",
    }[damage]  # fmt: skip
    if damage == "foreign":
        content = {"type": "FeatureCollection"}
    elif damage == "newer":
        content["version"] = 3
    elif damage == "twice":
        content["control_points"][2]["id"] = 0
    elif damage == "outside":
        content["control_points"][2]["x"] = 0.3
    text = json.dumps(content)
    marker.write_text(text[:-40] if damage == "cut" else text)
    assert phrase in complaint(capsys, *command.split())
    assert names(marker.parent) == {"marker.json"}


def test_results_on_standard_output_are_nothing_but_json(marker, capsys):
    assert main([*SMALL.split(), "--runs", "0", "--json", "-"]) == 0
    results = json.loads(capsys.readouterr().out)
    # 0.2 px of noise: a fifth of the 3.707 degrees of the default marker at 1 px.
    assert results["bound"]["rotation_deg"] == pytest.approx(0.2 * results["criteria"]["rotation_deg"])


def test_a_failed_check_is_status_1(marker, capsys):
    common = ["validate", "marker.json", "--runs", "0", "--views", "0"]
    few = [*common, "--poses", "cone:count=20"]
    assert main([*few, "--fail-if", "bound.rotation_deg > 0.1", "--fail-if", "bound.rotation_deg > 5"]) == 1
    message = capsys.readouterr().err
    assert "FAILED: bound.rotation_deg" in message
    assert "passed: bound.rotation_deg" in message
    assert main([*common, "--fail-if", "bound.by_polar_angle.17.5.rotation_deg > 5"]) == 0


def test_trials_for_all_measures_the_layouts_beside_it(marker, capsys):
    assert main([*SMALL.split(), "--runs", "2", "--trials-for-all", "--json", "-"]) == 0
    results = json.loads(capsys.readouterr().out)
    for row in results["comparisons"].values():
        assert row["estimators"]["lm"]["rotation_deg"]["count"] > 0
        assert row["bound"]["rotation_deg"] > 0


@pytest.mark.long
def test_a_marker_that_says_nothing_of_its_setting_gets_the_papers(marker, capsys):
    content = json.loads(marker.read_text())
    content["provenance"] = {}
    marker.write_text(json.dumps(content))
    assert main(["validate", "marker.json", "--runs", "0", "--views", "0", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["poses"]["count"] == 400


def test_debug_shows_where_an_error_came_from():
    with pytest.raises(Exception, match="at least 4"):
        main(["design", "--n", "3", "--debug"])


def test_a_reader_that_has_left_is_no_error():
    """Told by the first line, which here leaves within the command."""
    reader, writer = os.pipe()
    os.close(reader)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "markergen", "templates"]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, env=environment)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, "")


INTERRUPTED = {
    "validate ../marker.json --json r.json": set(),
    "design --n 12 --objective condition -o m.pdf": {"m.json", "m.pdf"},
}
"""Commands that take long, and what they write when they are interrupted: the best that a search has so far."""


def test_ctrl_c_ends_cleanly(marker):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    started = []
    for arguments, files in INTERRUPTED.items():
        folder = marker.parent / arguments.partition(" ")[0]
        folder.mkdir()
        command = [sys.executable, "-m", "markergen", *arguments.split()]
        started.append((subprocess.Popen(command, cwd=folder, env=environment, **pipes), folder, files))
    time.sleep(3)
    for process, folder, files in started:
        assert process.poll() is None, process.communicate()
        # As a terminal does: to the whole group, workers included.
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=20)
        # Python itself makes it the latter, which shells also call 130, if code in a string was running.
        assert process.returncode in (130, -signal.SIGINT), err
        assert "Traceback" not in err
        # What is written is written whole, which is no error.
        written = names(folder)
        assert ("markergen: error: interrupted" in err.splitlines()) != bool(written)
        assert ("search interrupted after" in out) == bool(written)
        assert written in (set(), files)
        assert ("wrote" in out) == bool(written)
        # Nobody of the group is left: asking it for a sign of life fails.
        deadline = time.monotonic() + 10
        while time.monotonic() < deadline and alive(process.pid):
            time.sleep(0.1)
        assert not alive(process.pid)


def alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True
