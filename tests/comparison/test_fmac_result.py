import json
from pathlib import Path

import numpy as np
import pytest

from markergen.api.compare import compare
from markergen.cli import main
from markergen.comparison import fmac as module
from markergen.comparison import series as engine
from markergen.comparison.contestants import printed
from markergen.comparison.fmac import degrees_figure
from markergen.errors import InputError
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.marker import build_marker
from markergen.validation.degrees import ERRORS

CORNERS = np.array([[-12, -12], [12, -12], [12, 12], [-12, 12]]) * 1e-3
SMALL = build_marker(CORNERS, Circle(0.025), 0.012, 0.001)
TAG = "aruco:DICT_4X4_50"


@pytest.fixture(scope="module")
def found():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "TUNING_VIEWS", 2)
        patch.setattr(engine, "BUDGET", 3)
        patch.setattr(printed, "IMAGES", {"image as it is": 1})
        yield compare(SMALL, TAG, protocol="fmac", views=10, workers=1)


def test_tables_have_every_contestant_and_error(found):
    tables = [part for part in found.parts() if not isinstance(part, str)]
    assert [len(table.rows) for table in tables] == [2, 2, 2, 2, 1]
    assert all(list(table.header)[1:] == list(ERRORS) for table in tables[1:4])
    frame = found.to_frame()
    assert len(frame) == 12
    assert set(frame["error"]) == set(ERRORS)
    assert found.plot().get_yscale() == "log"


@pytest.mark.long
def test_pictures_have_36_plots_of_each(found, tmp_path):
    assert len(degrees_figure(found.results).axes) == 72
    found.save(tmp_path / "c.json", tmp_path / "c.png")
    assert json.loads((tmp_path / "c.json").read_bytes()) == json.loads(found.to_json())
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")


def test_the_command_goes_on_from_kept_parts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("small.json").write_bytes(to_json(SMALL))
    arguments = ["compare", "small.json", "--protocol", "fmac", "--views", "2", "--workers", "1", "--parts", "kept"]
    monkeypatch.setattr(module, "OPPONENTS", ())
    assert main(arguments) == 0
    (part,) = Path("kept").iterdir()
    before = part.stat().st_mtime_ns
    assert main(arguments) == 0
    assert part.stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"protocol": "fmak"}, "known: none, fmac"),
        ({"protocol": "fmac", "poses": "paper"}, "--poses"),
        ({"parts": "kept"}, "--protocol"),
        ({"protocol": "fmac", "views": 10_001}, "10000 views"),
    ],
)
def test_options_that_do_not_go_together(options, message):
    with pytest.raises(InputError, match=message):
        compare(SMALL, TAG, **options)
