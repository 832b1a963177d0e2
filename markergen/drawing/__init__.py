"""Pictures as data: a scene of shapes in millimetres, text as outlines, and the sheet of paper around a marker."""
