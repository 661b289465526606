"""Logs read back: framing, verification, salvage, values."""
