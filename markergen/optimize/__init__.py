"""From a spec to a layout: feasible region, descent, polish, multi-start."""
