"""Fabrication drawing: its content as plain data, and its views and tables on paper."""
