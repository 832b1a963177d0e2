import importlib
import logging
import pickle
import sys
from traceback import format_exception

import pytest
from installed import describe

import markergen.registry
from markergen.errors import InputError
from markergen.registry import Registry, outside, receive, unforeseen
from markergen.studies.engines import ENGINES

GROUP = "markergen.numbers"


def test_names_are_looked_up_and_a_wrong_one_gets_help():
    registry: Registry[int] = Registry("number", "markergen.registry")
    registry.register("one", "uno")(1)
    assert registry["one"] == registry["uno"] == 1
    assert list(registry) == ["one", "uno"]
    with pytest.raises(InputError, match=r"number, found 'onn'; .* 'one'\? Known: one, uno"):
        registry["onn"]
    for wrong in ("xyz", 3, None, ["one"]):
        assert wrong not in registry
        with pytest.raises(InputError, match="known: one, uno"):
            registry[wrong]


def test_a_taken_name_is_refused():
    registry: Registry[int] = Registry("number", "markergen.registry")
    registry.register("one")(1)
    with pytest.raises(ValueError, match="registered twice"):
        registry.register("one")(2)


def test_what_is_no_entry_is_refused():
    registry: Registry[int] = Registry("number", "markergen.registry", entry=int)
    with pytest.raises(ValueError, match="number 'two' is str"):
        registry.register("two")("2")
    kinds: Registry[type[ArithmeticError]] = Registry("error", "markergen.registry", entry=type[ArithmeticError])
    kinds.register("zero")(ZeroDivisionError)
    with pytest.raises(ValueError, match="subclass of ArithmeticError"):
        kinds.register("key")(KeyError)


@pytest.fixture
def plugged(tmp_path, monkeypatch):
    """A table whose own entry is one, and packages that add to it."""
    modules = {
        "good_numbers": "two = 2\nthree = 3",
        "bad_numbers": "raise RuntimeError('broken\\ninside')",
        "odd_numbers": "one = 11\nfive = 'five'\ntwo = 22\nthree = 33",
    }
    for name, text in modules.items():
        (tmp_path / f"{name}.py").write_text(text)
    describe(tmp_path, "good-numbers", {GROUP: {"two": "good_numbers:two", "three": "good_numbers:three"}})
    describe(tmp_path, "bad-numbers", {GROUP: {"four": "bad_numbers:four", "six": "no_such_module:six"}})
    odd = {"one": "odd_numbers:one", "five": "odd_numbers:five", "three": "odd_numbers:three"}
    describe(tmp_path, "odd-numbers", {GROUP: odd | {"seven": "odd_numbers:seven"}})
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    monkeypatch.setattr(markergen.registry, "_TABLES", {})
    markergen.registry._installed.cache_clear()
    registry: Registry[int] = Registry("number", "markergen.registry", GROUP, int)
    registry._entries["one"] = 1
    yield registry
    receive({})
    markergen.registry._installed.cache_clear()
    for name in modules:
        sys.modules.pop(name, None)


def test_entries_of_packages_are_loaded_when_they_are_asked_for(plugged):
    assert plugged["one"] == 1
    assert "good_numbers" not in sys.modules
    assert "two" in plugged
    assert "good_numbers" not in sys.modules
    assert plugged["two"] == 2
    assert "bad_numbers" not in sys.modules


def test_those_that_do_not_work_are_left_out_with_a_warning(plugged, caplog):
    with caplog.at_level(logging.WARNING, "markergen"):
        assert list(plugged) == ["one", "two"]
        assert list(plugged) == ["one", "two"]
    message = [record.getMessage() for record in caplog.records if record.name == "markergen"]
    assert len(message) == 6
    assert all("\n" not in phrase for phrase in message)
    taken = next(phrase for phrase in message if "'one'" in phrase)
    assert "package odd-numbers, but markergen" in taken
    assert plugged["one"] == 1


@pytest.mark.parametrize(
    ("name", "phrase"),
    [
        ("four", "bad_numbers:four of the package bad-numbers fails with RuntimeError: broken inside"),
        ("five", "odd_numbers:five of the package odd-numbers is str, and not an instance of int"),
        ("six", "fails with ModuleNotFoundError: No module named 'no_such_module'"),
        ("seven", "fails with AttributeError"),
        ("three", "it in good_numbers:three of the package good-numbers and in odd_numbers:three of the package odd"),
    ],
)
def test_whoever_asks_for_one_is_told_why(plugged, name, phrase):
    assert name in plugged
    for _ in range(2):
        with pytest.raises(InputError, match=f"a working number '{name}'") as caught:
            plugged[name]
        assert phrase in str(caught.value)
        assert "\n" not in str(caught.value)


def test_an_error_in_a_plug_in_names_it_and_its_author(plugged, tmp_path):
    (tmp_path / "calling_numbers.py").write_text(
        "import pickle\nclass Eight(int):\n    def broken(self):\n        return pickle.loads(b'')\neight = Eight(8)\n"
    )
    describe(tmp_path, "calling-numbers", {GROUP: {"eight": "calling_numbers:eight"}})
    markergen.registry._installed.cache_clear()
    importlib.invalidate_caches()
    assert plugged["two"] == 2
    with pytest.raises(EOFError) as caught:
        plugged["eight"].broken()
    sentence = (
        "the number 'eight' failed: EOFError: Ran out of input; report it to the author of calling_numbers:eight "
    )
    assert unforeseen(caught.value, "report it") == f"{sentence}of the package calling-numbers"
    # A worker's error has its traceback as a note.
    worker_error = EOFError("Ran out of input")
    worker_error.add_note("".join(format_exception(caught.value)))
    assert unforeseen(worker_error, "report it").startswith(sentence)
    assert unforeseen(EOFError("here"), "report it") == "this should not happen: EOFError: here; report it"
    describe(tmp_path, "more-numbers", {GROUP: {"nine": "calling_numbers:eight"}})
    markergen.registry._installed.cache_clear()
    importlib.invalidate_caches()
    assert plugged["nine"] == 8
    assert unforeseen(caught.value, "report it").startswith("the number 'eight' or the number 'nine' failed: EOFError")
    sys.modules.pop("calling_numbers")


def test_an_unknown_name_hears_of_those_of_packages_that_work(plugged):
    with pytest.raises(InputError, match=r"known: one, two$"):
        plugged["eleventy"]


def test_what_a_script_registers_travels(plugged):
    plugged.register("answer")(42)
    # What comes with an installed package is found there, and not sent.
    assert plugged["two"] == 2
    luggage = outside()
    assert {group: [name for name, _ in packed] for group, packed in luggage.items()} == {GROUP: ["answer"]}
    elsewhere: Registry[int] = Registry("number", "markergen.registry", GROUP, int)
    assert "answer" not in elsewhere
    receive(luggage)
    assert elsewhere["answer"] == 42
    # A worker of a cluster lives on: the script's next version takes the place of this one.
    receive({GROUP: [("answer", pickle.dumps(43)), ("one", pickle.dumps(-1))]})
    assert elsewhere["answer"] == 43
    receive({})
    assert "answer" not in elsewhere


def test_a_table_is_pickled_by_reference():
    assert pickle.loads(pickle.dumps(ENGINES)) is ENGINES


def test_what_cannot_be_unpacked_is_told_when_it_is_asked_for(plugged):
    receive({GROUP: [("lost", b"cnowhere\nThing\n."), ("answer", b"I42\n.")]})
    assert plugged["answer"] == 42
    assert "lost" not in list(plugged)
    with pytest.raises(InputError, match="a worker process"):
        plugged["lost"]
