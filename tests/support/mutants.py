"""What may happen to a file on its way: bytes flip, pieces are replaced by others."""

from hypothesis import strategies as st

FLIPS = st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), min_size=1, max_size=4)
"""Places as shares of the file, and what they become."""


def flipped(data: bytes, changes) -> bytes:
    """Data with bytes changed as `FLIPS` has them."""
    mutant = bytearray(data)
    for place, value in changes:
        mutant[int(place * len(mutant))] = value
    return bytes(mutant)


def replaced(data: bytes, changes) -> bytes:
    """Data with pieces (place as a share, length, what comes instead) replaced one after the other."""
    for place, length, token in changes:
        start = int(place * len(data))
        token = token if isinstance(token, bytes) else token.encode()
        data = data[:start] + token + data[start + length :]
    return data


def mutants(seeds, tokens, longest: int):
    """Strategy of texts with up to three pieces replaced, cut off anywhere or with bytes flipped, and of any data."""
    data = st.sampled_from(seeds).map(str.encode)
    pieces = st.lists(st.tuples(st.floats(0, 1), st.integers(0, longest), st.sampled_from(tokens)), max_size=3)
    return st.one_of(
        st.builds(replaced, data, pieces),
        st.builds(lambda whole, share: whole[: int(share * len(whole))], data, st.floats(0, 1)),
        st.builds(flipped, data, FLIPS),
        st.binary(max_size=200),
        st.text(max_size=200).map(lambda text: text.encode("utf-8", "replace")),
    )
