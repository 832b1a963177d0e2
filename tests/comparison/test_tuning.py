import numpy as np

from markergen.comparison.series import Observation
from markergen.comparison.tuning import POSE, best_of, hardest_first, ranked, tune

TABLES = {"pattern": range(2), "detector": ["a", "b", "c"], "image": ["1", "2", "3"]}


def observed(errors):
    return [Observation(reason="none") if np.isnan(e) else Observation(e, e, np.array([e])) for e in errors]


def search(cost, budget=40):
    return tune(
        TABLES, lambda variant, choice, views: observed([cost(variant, **choice)] * len(views)), range(3), budget
    )


def test_the_best_setting_is_judged_where_all_worth_it_found_something():
    # The second misses half the views; of the others the third is better where both found it.
    columns = [observed([1.0] * 20), observed([0.1] * 10 + [np.nan] * 10), observed([0.9] * 19 + [np.nan])]
    assert best_of(columns) == 2
    assert best_of([observed([np.nan]), observed([2.0])]) == 1
    assert best_of([observed([np.nan]), observed([np.nan])]) == 0


def test_tables_that_act_together_are_searched_again():
    # Row c is the best in image 3 only: found in the second round of detectors.
    def cost(variant, detector, image):
        return {"a": 3, "b": 2, "c": 4}[detector] - {"a": 0.5, "b": 0.5, "c": 1.2}[detector] * int(image) + variant

    best, tried = search(cost)
    assert best == (0, {"detector": "c", "image": "3"})
    assert len({(variant, *choice.values()) for (variant, choice), _ in tried}) == len(tried)


def test_the_first_row_of_each_table_is_tried_first_and_stays_if_nothing_is_better():
    best, tried = search(lambda variant, detector, image: 1.0)
    assert best == tried[0][0] == (0, {"detector": "a", "image": "1"})
    assert len(tried) == 1 + 1 + 2 + 2


def test_half_of_the_settings_are_tried_in_twice_as_many_views():
    def observe(variant, choice, views):
        # The hard views distinguish the settings, and the first of them best.
        return observed([ord(choice["detector"]) * (1 + (view in hard)) for view in views])

    hard = set(range(3, 80, 8))
    (_, choice), tried = tune({"pattern": range(1), "detector": "ihgfedcba"}, observe, range(80), 40)
    assert choice == {"detector": "a"}
    columns = {choice["detector"]: column for (_, choice), column in tried}
    assert {row: len(column) for row, column in columns.items()} == dict.fromkeys("hgf", 20) | dict.fromkeys(
        "ed", 40
    ) | dict.fromkeys("icba", 80)
    assert {observation.rotation_deg for observation in columns["f"][:10]} == {2 * ord("f")}


def test_views_are_ordered_by_error_and_missed_ones_spread_evenly():
    assert hardest_first(observed([1.0, np.nan, 3.0, 2.0, np.nan, 9.0, 0.5])) == [5, 1, 2, 3, 0, 4, 6]
    assert hardest_first(observed([np.nan, np.nan])) == [0, 1]
    assert hardest_first([Observation(2.0, 1.0), Observation(1.0, 9.0)]) == [0, 1]
    assert hardest_first([Observation(2.0, 1.0), Observation(1.0, 9.0)], POSE) == [1, 0]


def test_settings_are_ranked_among_those_that_are_left():
    assert ranked([observed([3.0, 3.0]), observed([1.0, np.nan]), observed([2.0, 2.0])]) == [2, 0, 1]


def test_no_more_than_the_budget_is_tried():
    best, tried = search(lambda variant, detector, image: -ord(detector) - int(image) - variant, budget=5)
    assert len(tried) == 5
    assert best in [candidate for candidate, _ in tried]


def test_of_two_errors_the_product_counts():
    turned_right = [Observation(rotation_deg=1.0, translation_pct=9.0)] * 3
    balanced = [Observation(rotation_deg=2.0, translation_pct=2.0)] * 3
    assert best_of([turned_right, balanced]) == 0
    assert best_of([turned_right, balanced], POSE) == 1
