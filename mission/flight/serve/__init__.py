"""Simulated vehicles that stand alone, served to ground stations or to a firmware."""
