"""Geometry of an airspace in C: checks of points and legs, free places, shortest paths."""
