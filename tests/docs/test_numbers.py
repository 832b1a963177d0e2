"""Numbers in README and docs: `make numbers` compares them with what commands print; here, that none is left out."""

import subprocess
import sys

import pytest

from docs import numbers
from docs.given_numbers import GIVEN
from docs.number_table import MEASURED
from docs.numbers import (
    GENERATED,
    PAGES,
    ROOT,
    Block,
    Command,
    Given,
    Number,
    agree,
    alike,
    block,
    faults,
    numbers_in,
    uncovered,
)


@pytest.mark.parametrize("page", [page for page in PAGES if page not in GENERATED])
def test_every_number_has_a_command_or_a_reason(page):
    left = uncovered(page, [*MEASURED, *GIVEN])
    assert not left, "docs/number_table.py has no entry for\n" + "\n".join(left)


def test_places_have_numbers_and_their_commands_are_named_there():
    for entry in MEASURED:
        text = numbers.text_of(entry.file)
        assert " ".join(entry.named.split()) in " ".join(text.split()), entry.named
        if isinstance(entry, Block):
            assert block(entry).strip()
        else:
            assert numbers_in(text, entry.place), entry.place


def test_rounding():
    assert agree("3.71", 3.7145)
    assert agree("3.71", 3.705)
    assert not agree("3.71", 3.7151)
    assert not agree("3.7", 3.6)
    assert agree("1,647", 1647)
    assert agree("10", 25, factor=3)
    assert not agree("10", 31, factor=3)


def test_lines_of_a_block_may_differ_by_a_factor_and_counts_by_one():
    line = "from -0.5 [8.54, 12.5] (n = 4), holds in 2, open in 66"
    assert alike(line, line, 0)
    assert not alike(line, line.replace("8.54", "8.63"), 0)
    assert alike(line, line.replace("8.54", "8.63").replace("in 2", "in 3"), 1.05)
    assert not alike(line, line.replace("8.54", "9.63"), 1.05)
    assert not alike(line, line.replace("in 2", "in 4"), 1.05)
    assert not alike(line, line.replace("open", "fails"), 1.05)


def test_places_are_found_whatever_their_lines():
    text = "an error\nof 1.5 px (12 % more), -3 in all"
    assert numbers_in(text, "an error of # px (@ % more), #") == ["1.5", "-3"]
    assert numbers_in(text, "an error of # deg") is None
    assert numbers_in("a  b 7\n c 8 d", "a ... # c #") == ["7", "8"]


def test_numbers_are_those_with_a_unit_or_decimals(monkeypatch):
    text = """
12 dots of 36 mm, 2,500 s, 3 times as many, version 3 and 4.5; `--n 5.5` and [a](b-1.5.md).

    markergen design --radius 0.15  # takes 3 minutes
"""
    monkeypatch.setattr(numbers, "text_of", lambda file: text)
    assert [line.split()[1] for line in uncovered("a", [])] == ["36", "2,500", "3", "4.5", "3"]


def test_what_differs_is_told(monkeypatch):
    monkeypatch.setattr(numbers, "text_of", lambda file: "It is 2.5 px off by `true`, and 4 m away, 6 mm high.")
    right, wrong = Command("true", 1), Command("false", 1)
    entries = [Number("a", "It is # px off", "true", [(command, "off: #")]) for command in (right, wrong)]
    outputs = {right: "off: 2.46", wrong: "off: 2.6"}
    assert [list(faults(entry, outputs)) for entry in entries] == [
        [],
        ["a: 2.5 in the text, 2.6 by true: It is # px off"],
    ]
    assert list(faults(entries[0], {})) == []
    assert "does not print" in next(faults(entries[0], {right: "nothing"}))
    stated = Given("a", "# m away", "a place")
    assert [line.split(" in ")[0] for line in uncovered("a", [entries[0], stated])] == ["a:1: 6"]


def test_the_command_starts_and_has_nothing_to_do_without_time():
    """Also as a program of its own, whose module has another name than the one that the table imports."""
    done = subprocess.run(
        [sys.executable, "-m", "docs.numbers", "--quick", "0"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("0 of ")
    assert f"0 of {len(MEASURED)} places checked, 0 differ" in done.stdout
