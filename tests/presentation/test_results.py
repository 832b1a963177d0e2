"""Results are shown and written in one way, and refuse what could not be written before any work is done."""

import doctest
import json
from pathlib import Path

import numpy as np
import pytest
from sentences import pattern

from markergen.errors import InputError, OutputError
from markergen.presentation import results
from markergen.presentation.results import SavableResult, Targets, json_bytes, plain


class Measured(SavableResult):
    KINDS = {".json": "json", ".html": "report", ".svg": "plot"}  # noqa: RUF012

    def parts(self):
        return ["two dots"]

    def to_json(self):
        return json_bytes({"dots": 2})

    def content(self, kind, path):
        return self.to_json() if kind == "json" else f"{kind} {path.name}".encode()

    def save(self, *paths, json=None, plot=None):
        return self.write(self.targets(paths, json=json, plot=plot).checked())


def test_files_hold_what_their_suffix_or_their_keyword_says(tmp_path):
    written = Measured().save(tmp_path / "a.SVG", str(tmp_path / "b.html"), json=tmp_path / "c.txt")
    assert [item.path.read_bytes() for item in written] == [b"plot a.SVG", b"report b.html", b'{\n  "dots": 2\n}\n']


def test_what_could_not_be_written_is_refused_and_nothing_is_changed(tmp_path):
    result = Measured()
    with pytest.raises(InputError, match="path to write"):
        result.save()
    with pytest.raises(InputError, match=r"ends in \.json, \.html, \.svg"):
        result.save(tmp_path / "a.txt")
    with pytest.raises(InputError, match="a picture"):
        result.save(plot=tmp_path / "a.html")
    with pytest.raises(InputError, match="for json"):
        result.save(json=3)
    with pytest.raises(OutputError, match="asked for twice"):
        result.save(tmp_path / "a.json", json=tmp_path / "a.json")
    with pytest.raises(OutputError, match=pattern("input overwritten")):
        result.targets([tmp_path / "a.json"]).check([tmp_path / "a.json"])
    assert not list(tmp_path.iterdir())


def test_a_folder_for_pictures_is_made_before_the_work(tmp_path):
    folder = tmp_path / "views"
    targets = Measured.targets(pictures=str(folder))
    assert targets == Targets((), folder)
    assert targets.checked() is targets
    assert folder.is_dir()


def test_a_result_holds_json_alone_unless_its_class_says_more():
    class Plain(Measured):
        content = SavableResult.content

    assert Plain().content("json", Path("a.json")) == Plain().to_json()
    with pytest.raises(ValueError, match="plot"):
        Plain().content("plot", Path("a.svg"))


def test_json_has_no_nan():
    values = {"a": np.float64(1.5), 2: (np.nan, -np.inf, np.int64(3)), "b": [None, "x", True]}
    assert json.loads(json_bytes(plain(values))) == {"a": 1.5, "2": [None, None, 3], "b": [None, "x", True]}
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_bytes([np.nan])


def test_the_examples_run():
    assert doctest.testmod(results).failed == 0
