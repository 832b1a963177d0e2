"""Poses of markers and rigs in ROS 2."""
