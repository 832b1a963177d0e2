"""The functions that users call: they take what users have, call what does the work, and return results to look at."""
