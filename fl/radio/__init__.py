"""The air-to-ground radio: its channel, and which packets get through."""
