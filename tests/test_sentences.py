"""The catalog of sentences has none that no test knows any longer."""

import re
from pathlib import Path

from sentences import SENTENCES, pattern, sentence


def test_every_sentence_is_in_use():
    texts = (path.read_text(encoding="utf-8") for path in Path(__file__).parent.rglob("test_*.py"))
    used = {key for text in texts for key in re.findall(r"""(?:sentence|pattern)\(\s*["']([^"']+)["']""", text)}
    assert set(SENTENCES) - used == set()


def test_gaps_are_filled_with_text_or_expressions():
    assert sentence("dot off", 3, "0.2 mm") == "dot 3 is 0.2 mm off"
    assert pattern("plate off", "[01]", "2 mm", ".*") == r"plate\ [01]\ is\ 2 mm\ off\ \(.*\),\ in\ its\ own\ frame"
