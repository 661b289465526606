"""Finished flights read back, and compared with what was planned."""
