"""A page in the browser to design on: a small server, and what it says of a layout."""
