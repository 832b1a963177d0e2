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
