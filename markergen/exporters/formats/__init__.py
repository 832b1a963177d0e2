"""The table of output formats: what each holds. What writes them is imported when a file is written."""
