"""One `aerofed run`: the loop over its rounds, and what is around it."""
