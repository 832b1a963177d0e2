"""Pictures as data: a scene of shapes in millimeters, text as outlines, and the sheet of paper around a marker."""
