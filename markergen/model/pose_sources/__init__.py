"""The table of pose distributions that are asked for by a text; each module puts its own into `model.poses.POSES`."""
