"""Lines for a terminal of any width."""

from hypothesis import given
from hypothesis import strategies as st

from markergen.presentation.tables import cells, table_lines, wrapped

WORDS = st.text("abcdefgh0123456789.-", min_size=1, max_size=12)
SENTENCES = st.lists(WORDS, min_size=1, max_size=20).map(" ".join)


@given(SENTENCES, st.integers(50, 120))
def test_sentences_break_between_words_alone(text, width):
    lines = wrapped(text, width)
    assert " ".join(lines).split() == text.split()
    assert all(cells(line) <= width or " " not in line.strip() for line in lines if not _held(line))


def _held(line):
    """Whether a line is long for a number that keeps its unit, or several of them."""
    return any(word[-1].isdigit() for word in line.split()[:-1])


@given(
    st.integers(1, 9).flatmap(lambda k: st.lists(st.lists(SENTENCES, min_size=k, max_size=k), min_size=1, max_size=4)),
    st.integers(50, 120),
)
def test_tables_break_no_word_and_lose_none(rows, width):
    header = [f"head{k}" for k in range(len(rows[0]))]
    lines = table_lines(header, rows, width)
    message = " ".join(lines).split()
    for row in rows:
        for cell in row:
            for word in cell.split():
                assert word in message


def test_a_number_keeps_its_unit():
    assert wrapped("Plan with 2.8 deg and 1.5 mm", 13) == ["Plan with", "2.8 deg and", "1.5 mm"]


def test_words_stand_left_and_numbers_right():
    rows = [["a", "some words", "1"], ["b", "others here", "22"], ["c", "", "3"], ["d", "", "4"]]
    lines = table_lines(["x", "text", "number"], rows, 60)
    assert lines[2].index("some") == lines[3].index("others")
    assert lines[2].endswith(" 1")
    assert lines[3].endswith("22")
