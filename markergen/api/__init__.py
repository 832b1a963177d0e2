"""The functions of the library: each takes objects, paths or texts, and returns a result."""
