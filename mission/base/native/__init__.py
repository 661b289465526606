"""Where may be flown, in C: legs, places and ways."""
