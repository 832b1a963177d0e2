"""Speed and quality beside a peer or a floor in the same run; `python -m benchmarks` prints the quick ones."""
