"""Table of output formats and their properties. The writers are imported when a file is written."""
