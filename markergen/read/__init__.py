"""Readers of what users bring: specs now; outlines, cameras and poses follow."""
