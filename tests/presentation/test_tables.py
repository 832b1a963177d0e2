import doctest
import io
import sys

import numpy as np
import pytest

from markergen.errors import MissingLibraryError
from markergen.presentation import tables
from markergen.presentation.results import Result
from markergen.presentation.tables import Table, csv_bytes, data_frame, number, percent, print_parts

HOSTILE = "<script>[red]a&b[/red]:smile:"


class Told(Result):
    def __init__(self, *parts):
        self._parts = parts

    def parts(self):
        return self._parts

    def to_json(self):
        return b"{}"


def test_nothing_is_cut_off_and_nothing_is_markup():
    table = Table("title", ["file", "n", "m"], [[HOSTILE, "1", "2"], ["x" * 150, "10", "20"]], "caption")
    lines = table.text().splitlines()
    assert lines[0] == "title"
    assert lines[-1] == "caption"
    assert HOSTILE in table.text()
    # A path can be copied whole, however narrow the terminal.
    for width in (40, 100):
        wide = [line for line in table.text(width).splitlines() if len(line) > width]
        assert wide == [f"  {'x' * 150}"]


def test_html_is_escaped():
    html = Table(HOSTILE, [HOSTILE], [[HOSTILE]], HOSTILE).html()
    assert "<script>" not in html
    assert html.count("&lt;script&gt;[red]a&amp;b[/red]:smile:") == 4
    assert "<caption>" not in Table("", ["a"], [["b"]]).html()


def test_a_result_shows_its_parts_in_order():
    result = Told("two\nlines", Table("t", ["a", "b"], [["1", "2"]]), HOSTILE)
    assert str(result).splitlines()[:2] == ["two", "lines"]
    assert str(result).splitlines()[-1] == HOSTILE
    html = result._repr_html_()
    assert "<p>two<br>lines</p>" in html
    assert "<script>" not in html
    out = io.StringIO()
    print_parts(result.parts(), out)
    assert out.getvalue() == str(result) + "\n"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (None, 3, "-"),
        (0.0, 3, "0.00"),
        (1234.0, 3, "1230"),
        (1.234e6, 3, "1.23e+06"),
        (123.0, 3, "123"),
        (1e-7, 3, "<1e-6"),
        (2.5, 2, "2.5"),
    ],
)
def test_numbers_have_as_many_digits_as_asked_for(value, digits, text):
    assert number(value, digits) == text


def test_shares():
    assert [percent(share) for share in (None, 0, 0.1234, 1)] == ["-", "0 %", "12.3 %", "100 %"]


def test_csv_has_no_cell_for_what_is_not_there():
    rows = [{"a": 1, "b": np.float32(0.25), "c": np.nan}, {"a": "x,y", "c": -np.inf}, {"b": None, "c": 1 / 3}]
    assert csv_bytes(rows, digits=4) == b'a,b,c\n1,0.25,\n"x,y",,\n,,0.3333\n'
    assert csv_bytes(rows, ["c", "b", "a"]).splitlines()[::3] == [b"c,b,a", b"0.333333333,,"]
    with pytest.raises(ValueError, match="not in fieldnames"):
        csv_bytes(rows, ["a"])


def test_data_frames_need_pandas(frames_of_rows, monkeypatch):
    rows = [{"a": 1, "b": 2}]
    assert data_frame(rows) == rows
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingLibraryError, match="pip install pandas"):
        data_frame(rows)


@pytest.fixture
def frames_of_rows(monkeypatch):
    from types import SimpleNamespace

    monkeypatch.setitem(sys.modules, "pandas", SimpleNamespace(DataFrame=list))


def test_the_examples_run():
    assert doctest.testmod(tables).failed == 0
