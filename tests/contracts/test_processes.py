"""What every process of the table keeps to; what comes of it as a solid is looked at in tests/solid."""

from dataclasses import fields

import pytest

from markergen.errors import InputError
from markergen.model.fabrication import CHOICES, DEFAULT_PROCESS, PROCESSES, Fabrication
from markergen.workshop.processes import Made, parts_of


@pytest.fixture
def marker(make_ngon):
    return make_ngon(5, 0.1, 0.02)


@pytest.mark.parametrize("name", list(PROCESSES))
def test_it_says_what_it_is_called_and_what_it_knows(name):
    process = PROCESSES[name]
    assert process.label == process.label.strip(" .")
    assert process.summary == process.summary.strip(" .") != ""
    assert set(process.choices) <= set(CHOICES) <= {field.name for field in fields(Fabrication)}


@pytest.mark.parametrize("name", list(PROCESSES))
def test_it_makes_the_same_parts_every_time(name, marker):
    made = PROCESSES[name](marker, Fabrication(name))
    assert isinstance(made, Made)
    assert made == PROCESSES[name](marker, Fabrication(name))
    assert made.depth > 0
    assert made.parts or made.cut or made.marked
    assert made.accuracy.position or made.tolerances
    assert all(line.endswith((".", ":")) and line[0].isupper() for line in (*made.lines, *made.notes))
    parts = parts_of(marker, Fabrication(name, engrave=False)).parts
    assert len({part.name for part in parts}) == len(parts)
    assert parts[0].is_plate


@pytest.mark.parametrize("name", list(PROCESSES))
def test_choices_of_others_are_refused(name):
    values = {"fit": "slip", "through": True, "dome": "ball"}
    assert set(values) == set(CHOICES)
    for choice, value in values.items():
        if choice in PROCESSES[name].choices:
            assert getattr(Fabrication(name, **{choice: value}), choice) == value
        else:
            with pytest.raises(InputError, match=f"{CHOICES[choice]} with --process .*, found --process {name}"):
                Fabrication(name, **{choice: value})


def test_the_default_is_one_of_them():
    assert DEFAULT_PROCESS in PROCESSES
    assert not PROCESSES[DEFAULT_PROCESS].choices
