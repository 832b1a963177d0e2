import pytest

from markergen.errors import InputError
from markergen.registry import Registry


def test_names_are_looked_up_and_a_wrong_one_gets_help():
    registry: Registry[int] = Registry("number", "markergen.registry")
    registry.register("one", "uno")(1)
    assert registry["one"] == registry["uno"] == 1
    assert list(registry) == ["one", "uno"]
    with pytest.raises(InputError, match=r"known number, found 'onn'; did you mean 'one'\? Known: one, uno"):
        registry["onn"]
    with pytest.raises(InputError, match="known: one, uno"):
        registry["xyz"]


def test_a_taken_name_is_refused():
    registry: Registry[int] = Registry("number", "markergen.registry")
    registry.register("one")(1)
    with pytest.raises(ValueError, match="registered twice"):
        registry.register("one")(2)
