import pickle

from markergen.errors import InputError


def test_an_error_says_three_things_and_survives_a_worker():
    error = InputError("a radius above 0", "radius=-1 m", "give a length")
    assert str(error) == "expected a radius above 0, found radius=-1 m; give a length"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
