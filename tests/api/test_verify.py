import json
import logging
import pickle
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from markergen.api import verify as module
from markergen.api.verify import verify
from markergen.cli import main
from markergen.errors import InputError, MissingLibraryError, OutputError
from markergen.exporters.saving import save
from markergen.model.body_json import to_json

HOSTILE = "<script>[red]x.csv"


@pytest.fixture(scope="module")
def marker(make_ngon):
    return make_ngon(5, 0.05, 0.012)


@pytest.fixture(scope="module")
def written(marker, make_ngon, tmp_path_factory):
    folder = tmp_path_factory.mktemp("verify")
    (folder / "marker.json").write_bytes(to_json(marker))
    save(marker, [folder / "marker.csv", folder / "marker.svg"])
    save(make_ngon(6, 0.05, 0.012), [folder / "other.csv"])
    return folder


@pytest.fixture
def here(written, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_check_of_each_file_in_their_order(here, marker):
    verification = verify(marker, "marker.csv", here / "other.csv", "none.csv", "marker.svg")
    assert isinstance(verification, Sequence)
    assert [check.path for check in verification] == ["marker.csv", str(here / "other.csv"), "none.csv", "marker.svg"]
    assert [check.passed for check in verification] == [True, False, False, True]
    assert len(verification[1:]) == 3
    assert verification[2].error
    assert not verification.passed
    assert not verification.usable
    # What fails is a sequence all the same.
    assert verification
    good = verify("marker.json", "marker.csv")
    assert good.passed
    assert good.usable
    assert good[0].dots == 5
    assert verify(json.loads(Path("marker.json").read_text()), "marker.csv").passed


def test_a_tolerance_is_a_length(here, marker, make_marker):
    save(make_marker(0.999 * marker.xyz[:, :2], 0.05, 0.012), [here / "scaled.pdf"])
    assert not verify(marker, "scaled.pdf").passed
    assert verify(marker, "scaled.pdf", tolerance="0.1mm").passed
    assert verify(marker, "scaled.pdf", tolerance=1e-4).passed


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ([3, "marker.csv"], {}, "dict of marker.json"),
        (["none.json", "marker.csv"], {}, "none.json"),
        (["marker.json"], {}, "files to verify"),
        (["marker.json", None], {}, "files to verify"),
        (["marker.json", 5], {}, "a path"),
        (["marker.json", b"marker.csv"], {}, "a path"),
        (["marker.json", "marker.csv"], {"tolerance": 0}, "tolerance above 0"),
        (["marker.json", "marker.csv"], {"tolerance": "much"}, "tolerance='much' (a length"),
        (["marker.json", "marker.csv"], {"tolerence": 1}, "did you mean 'tolerance'?"),
        (["marker.json", "marker.csv"], {"save": "found.txt"}, ".json"),
    ],
)
def test_bad_input_is_our_own_error_in_one_line(here, arguments, options, message):
    before = set(here.iterdir())
    with pytest.raises(InputError) as caught:
        verify(*arguments, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert set(here.iterdir()) == before


def test_what_cannot_be_written_is_told_before_the_work(here, monkeypatch):
    monkeypatch.setattr(module, "verify_all", None)
    for path in ("marker.json", "marker.csv", "no/found.json"):
        with pytest.raises(OutputError):
            verify("marker.json", "marker.csv", json=path)


def test_saving_nothing_is_refused_and_none_asks_for_nothing(here):
    verification = verify("marker.json", "marker.csv", save=None)
    with pytest.raises(InputError, match="write to, found none"):
        verification.save()


def test_files(here, marker):
    verification = verify(marker, "marker.csv", "other.csv", save="found.json", json="plain")
    assert [str(file) for file in verification.written] == ["wrote found.json", "wrote plain"]
    assert Path("found.json").read_bytes() == Path("plain").read_bytes() == verification.to_json()
    assert [check["passed"] for check in json.loads(verification.to_json())] == [True, False]
    verification.save(here / "again.json")
    assert Path("again.json").read_bytes() == verification.to_json()


def test_printed_it_is_what_the_command_prints(here, marker, capsys):
    verification = verify(marker, "marker.csv", "other.csv")
    assert main(["verify", "marker.json", "marker.csv", "other.csv"]) == 1
    assert capsys.readouterr().out == str(verification) + "\n"
    assert "WRONG" in str(verification)
    # The command tells on stderr what could not be used.
    assert "none.csv" in str(verify(marker, "none.csv"))


def test_short_and_escaped_whatever_files_are_called(here, marker):
    Path("marker.csv").rename(HOSTILE)
    verification = verify(marker, *[HOSTILE] * 9, "n" * 200)
    assert len(repr(verification)) < 2000
    assert "and 2 more" in repr(verification)
    assert "<script>" not in verification._repr_html_()
    assert "&lt;script&gt;[red]x.csv" in verification._repr_html_()
    assert HOSTILE in str(verification)


def test_rows_for_each_file(here, marker, make_ngon, frames, monkeypatch):
    save(make_ngon(6, 0.05, 0.012), [here / "other.pdf"])
    verification = verify(marker, "marker.csv", "other.pdf")
    rows = verification.to_frame()
    assert [(row["file"], row["passed"]) for row in rows] == [("marker.csv", True), ("other.pdf", False)]
    assert rows[0]["largest_m"] < 1e-6
    assert "another marker" in rows[1]["findings"]
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingLibraryError, match="pip install pandas"):
        verification.to_frame()


def test_it_can_be_sent_to_another_process_and_tells_the_log_alone(here, marker, caplog, capsys):
    with caplog.at_level(logging.INFO, "markergen"):
        verification = verify(marker, "marker.csv")
    assert str(pickle.loads(pickle.dumps(verification))) == str(verification)
    assert len(caplog.records) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "")
