import cv2
import numpy as np

from markergen.render.png import png

IMAGE = np.arange(60 * 80, dtype=np.uint8).reshape(60, 80)


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)


def test_plain_image_survives_unchanged():
    np.testing.assert_array_equal(decoded(png(IMAGE)), IMAGE)


def test_marks_are_drawn_where_asked_and_nowhere_else():
    drawn = decoded(png(IMAGE, np.array([[20.0, 40.0], [np.nan, 3.0]]), [7, 8]))
    colored = np.ptp(drawn.astype(int), axis=-1) > 0
    assert colored[40, 20]
    rows, columns = np.nonzero(colored)
    assert rows.min() >= 15
    assert rows.max() <= 46
    assert columns.max() <= 45


def test_same_input_gives_the_same_bytes():
    assert png(IMAGE, np.array([[20.3, 40.7]])) == png(IMAGE, np.array([[20.3, 40.7]]))
