import numpy as np
import pytest

from markergen.api.study import study
from markergen.errors import InputError

SWEEP = {
    "dot": "20mm",
    "restarts": 2,
    "poses": "cone:count=20",
    "study": {"estimators": ["ippe"]},
    "grid": {"n": [4, 5], "layout": ["ngon"]},
}


@pytest.mark.long
def test_a_sweep_of_a_dictionary_as_a_frame(tmp_path):
    seen = []
    results = study(SWEEP, tmp_path / "s", workers=1, runs=2, progress=lambda *output: seen.append(output[:2]))
    assert seen[-1] == (4, 4)
    assert {path.name for path in results} >= {"table.csv", "index.html"}
    assert all(path.is_file() for path in results)
    assert str(results).splitlines()[0].startswith("wrote ")
    assert len(repr(results)) < 300
    frame = results.to_frame()
    row = frame[(frame.polar_angle_deg == "all") & (frame.n == 5)].iloc[0]
    assert row.estimator == "ippe"
    assert row.rotation_bound_deg > 0
    with pytest.raises(InputError, match="known: table"):
        results.to_frame("tables")
    again = study(SWEEP, str(tmp_path / "s"), workers=1, runs=2, resume=True)
    assert [path.name for path in again] == [path.name for path in results]


def test_the_log_tells_of_begin_and_end(tmp_path, caplog, capsys):
    with caplog.at_level("INFO", "markergen"):
        study(SWEEP | {"grid": {"n": [4], "layout": ["ngon"]}}, tmp_path / "s", workers=1, runs=0)
    message = [record.getMessage() for record in caplog.records if record.name == "markergen.api.study"]
    assert message[0] == f"studying, in {tmp_path / 's'}"
    assert message[-1].startswith("studied: ")
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("what", "options", "phrase"),
    [
        (3, {}, "a path, found 3"),
        ("none-such", {}, "known: paper, layouts"),
        (SWEEP, {"scale": 0.1}, "--scale with the study paper"),
        (SWEEP, {"workers": 0}, "1 to 256 workers"),
        (SWEEP, {"progress": 1}, "a function for progress, found 1"),
        (np.array([1, 2]), {}, "a path, found array([1, 2])"),
        (SWEEP, {"wrokers": 1}, "did you mean 'workers'?"),
        ({"grid": {"m": [1]}}, {}, "grid.m"),
    ],
)
def test_bad_wishes(what, options, phrase, tmp_path):
    with pytest.raises(InputError) as caught:
        study(what, tmp_path / "s", **options)
    assert phrase in str(caught.value)
