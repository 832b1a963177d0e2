import pytest
from hypothesis import given
from hypothesis import strategies as st

from markergen.errors import InputError
from markergen.validation.result import check_condition

RESULTS = {
    "runs": 100,
    "views": None,
    "marker": {"name": "pentagon", "good": True},
    "comparisons": [{"pose": 9.7}, {"pose": 8.7}],
    "estimators": {
        "lm": {
            "rotation_deg": {"rms": 0.612, "mean": 0.4},
            "efficiency": None,
            "by_polar_angle": {"0": {"rms": 1.5}, "17.5": {"rms": 0.48}, "20..30": {"rms": 0.2}},
        }
    },
}


@pytest.mark.parametrize(
    ("expression", "passed", "message"),
    [
        ("estimators.lm.rotation_deg.rms > 0.5", False, "estimators.lm.rotation_deg.rms = 0.612 > 0.5"),
        ("estimators.lm.rotation_deg.rms>0.7", True, "estimators.lm.rotation_deg.rms = 0.612 <= 0.7"),
        ("estimators.lm.by_polar_angle.17.5.rms < 1", False, "estimators.lm.by_polar_angle.17.5.rms = 0.48 < 1"),
        ("estimators.lm.by_polar_angle.20..30.rms >= .3", True, "estimators.lm.by_polar_angle.20..30.rms = 0.2 < .3"),
        ("comparisons.1.pose <= 8.7", False, "comparisons.1.pose = 8.7 <= 8.7"),
        ("runs >= 100", False, "runs = 100 >= 100"),
        ("runs > 1e2", True, "runs = 100 <= 1e2"),
        ("  runs<-1.5  ", True, "runs = 100 >= -1.5"),
    ],
)
def test_comparison(expression, passed, message):
    assert check_condition(expression, RESULTS) == (passed, message)


@pytest.mark.parametrize(
    "expression",
    ["", "runs", "runs >", "> 3", "runs = 3", "runs == 3", "runs > x", "runs > nan", "runs > inf", "runs > 1 2",
     "runs > 3 and runs < 4", "runs => 3", "runs > 0x10"],
)  # fmt: skip
def test_malformed(expression):
    with pytest.raises(InputError, match="a path, one of > >= < <=,"):
        check_condition(expression, RESULTS)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("estimator.lm", "in the results, found 'estimator.lm'; known there: runs, views, marker, comparisons"),
        ("estimators.ml.rms", "under 'estimators', found 'ml.rms'; known there: lm"),
        ("estimators.lm", "under 'estimators.lm', found a group; known there: rotation_deg, efficiency"),
        ("estimators.lm.by_polar_angle.18.rms", "found '18.rms'; known there: 0, 17.5, 20..30"),
        ("estimators.lm.by_polar_angle.17.5.max", "under 'estimators.lm.by_polar_angle.17.5', found 'max'; known"),
        ("comparisons.2.pose", "under 'comparisons', found '2.pose'; known there: 0, 1"),
        ("runs.rms", "under 'runs', found no 'rms' in it: 100 is a value; end the path at 'runs'"),
        ("views", "results under 'views', found none in this run"),
        ("views.detected", "results under 'views', found none in this run"),
        ("marker.name", "a number at 'marker.name', found 'pentagon'"),
        ("marker.good", "found True"),
    ],
)
def test_path_to_no_number_says_what_there_is(path, message):
    with pytest.raises(InputError) as error:
        check_condition(f"{path} > 1", RESULTS)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_key_with_dots_does_not_hide_a_group_of_the_same_beginning():
    results = {"a.b": {"c": 1}, "a": {"b": {"d": 2}}}
    assert check_condition("a.b.c > 0", results)[0] is False
    assert check_condition("a.b.d > 1", results)[0] is False


@given(st.text())
def test_any_text_gives_an_answer_or_one_line(expression):
    try:
        passed, message = check_condition(expression, RESULTS)
    except InputError as error:
        message, passed = str(error), None
    assert isinstance(message, str)
    assert passed in (True, False, None)


KEYS = st.text("ab15.", min_size=1, max_size=5).map(lambda key: key.strip(".") or "a")
NUMBERS = st.floats(-1e6, 1e6)
TREES = st.recursive(NUMBERS, lambda child: st.dictionaries(KEYS, child, min_size=1, max_size=4), max_leaves=12)


def leaves(tree, path=()):
    if isinstance(tree, dict):
        for key, child in tree.items():
            yield from leaves(child, (*path, key))
    else:
        yield ".".join(path), tree


@given(st.dictionaries(KEYS, TREES, min_size=1, max_size=4), NUMBERS)
def test_every_number_can_be_reached(results, limit):
    """Where two leaves have the same dotted path, either will do."""
    result = {}
    for path, value in leaves(results):
        result.setdefault(path, []).append(value)
    for path, values in result.items():
        passed, message = check_condition(f"{path} > {limit!r}", results)
        assert passed in {not value > limit for value in values}
        assert message.startswith(f"{path} = ")


def test_a_value_that_does_not_exist_fails_the_check():
    passed, message = check_condition("estimators.lm.efficiency < 0.9", RESULTS)
    assert not passed
    assert "no value" in message
