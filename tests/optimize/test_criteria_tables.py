from markergen.objectives.survive import HiddenDots
from markergen.optimize.criteria_tables import criteria_table, hidden_table

FLAT = {"pose_m": 0.0086638, "rotation_deg": 2.7742, "translation_pct": 0.5431, "homography_px": 1.5, "condition": 3.0}


def test_a_row_for_each_layout_in_the_units_of_its_column():
    table = criteria_table({"design": FLAT, "ngon": FLAT, "square": {"pose_m": 0.01}}, 5, "image noise of 1 px")
    assert table.title == "What the layout allows, for image noise of 1 px"
    assert table.header == ["", "pose mm", "rotation deg", "translation %", "homography px", "c(A)"]
    assert table.rows[0] == ["this marker", "8.664", "2.774", "0.5431", "1.500", "3.000"]
    assert [row[0] for row in table.rows] == ["this marker", "regular 5-gon", "square, 4 dots"]
    # A relief lacks some.
    assert table.rows[2][1:] == ["10.00", "-", "-", "-", "-"]


def test_worst_and_mean_with_dots_hidden():
    errors = [HiddenDots(0, FLAT, FLAT, ()), HiddenDots(1, FLAT, FLAT, (3,)), HiddenDots(2, FLAT, FLAT, (0, 3))]
    names = [row[0] for row in hidden_table(errors, "noise").rows]
    assert names == [
        "none hidden",
        "worst: dot 3 hidden",
        "mean of any 1 hidden",
        "worst: dots 0, 3 hidden",
        "mean of any 2 hidden",
    ]
