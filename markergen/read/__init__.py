"""Readers of user input: specs, outlines, cameras, poses, images and measured dots."""
