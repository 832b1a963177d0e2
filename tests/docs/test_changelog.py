"""The changelog keeps the form of Keep a Changelog, a line for each change."""

import re
from pathlib import Path

import markergen

TEXT = (Path(__file__).parents[2] / "CHANGELOG.md").read_text(encoding="utf-8")
KINDS = ["Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"]


def test_versions_have_dates_and_begin_with_what_is_unreleased():
    unreleased, *released = re.findall(r"^## (.+)$", TEXT, re.MULTILINE)
    assert unreleased == "[Unreleased]"
    versions = [re.fullmatch(r"\[(\d+\.\d+\.\d+)\] - (\d{4}-\d{2}-\d{2})", heading).groups() for heading in released]
    assert versions[0][0] == markergen.__version__
    dates = [date for _, date in versions]
    assert dates == sorted(dates, reverse=True)


def test_changes_are_sorted_by_kind():
    for version in TEXT.split("\n## ")[1:]:
        headings = re.findall(r"^### (.+)$", version, re.MULTILINE)
        assert headings
        assert headings == [kind for kind in KINDS if kind in headings], version.splitlines()[0]
        assert all(re.match(r"\n*- ", changes) for changes in re.split(r"^### .+$", version, flags=re.MULTILINE)[1:])


def test_a_change_is_one_line_of_at_most_25_words():
    lines = [line for line in TEXT.partition("\n## ")[2].splitlines()[1:] if line and not line.startswith("#")]
    assert not [line for line in lines if not line.startswith("- ")]
    assert not [line for line in lines if len(line.removeprefix("- ").split()) > 25]
