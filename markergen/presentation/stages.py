"""Words for the stages of a search or comparison, for people who watch it."""
# tests: tests/studio/test_server.py

STAGES = {
    "number of dots": "trying numbers of dots",
    "refinement": "settling the number of dots",
    "radius": "trying sizes of the marker",
    "dot size": "trying sizes of dots",
    "scales": "trying dots of several sizes",
    "regular": "trying regular layouts",
    "descent": "moving dots downhill",
    "exchange": "trying other places",
    "polish": "fine adjustment",
    "hops": "moving single dots away",
    "asymmetric": "telling dots apart",
    "relief": "raising dots",
    "together": "all sizes together",
    "plates": "one plate after the other",
    "lower bound": "what is possible at best",
    "settings": "tuning other detectors",
}
"""By the names that callers of a search get; other names are words already."""
