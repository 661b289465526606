"""One `aerofed fly`: a plan file checked, flown and recorded."""
