"""Rounds of several aircraft, planned jointly."""
