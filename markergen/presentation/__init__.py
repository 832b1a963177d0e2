"""Presentation of results: `tables` for the terminal, CSV and data frames, `plots` in SVG, `pages` in HTML.

`results` is the common base of the results of the library's functions. Equal values give equal bytes, and text from
files is escaped everywhere.
"""
