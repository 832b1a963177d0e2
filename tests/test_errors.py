import pickle

from markergen.errors import InputError, install


def test_an_error_says_three_things_and_survives_a_worker():
    error = InputError("a radius above 0", "radius=-1 m", "give a length")
    assert str(error) == "expected a radius above 0, found radius=-1 m; give a length"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


def test_an_extra_is_installed_from_where_this_runs(monkeypatch, tmp_path):
    assert install("step") == "pip install ./detector '.[step]'"
    monkeypatch.setattr("markergen.errors.__file__", str(tmp_path / "markergen" / "errors.py"))
    assert install("step") == "pip install 'markergen[step]'"
