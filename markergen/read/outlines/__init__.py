"""Outlines from drawings: a table of formats, told apart by what is in the file, not by its name."""
