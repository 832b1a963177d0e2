"""One way to present results: `tables` for the terminal, CSV and data frames, `plots` in SVG, `pages` in HTML.

`results` holds what the results of the library's functions have in common. The same values give the same bytes, and
text that comes from files is escaped everywhere.
"""
