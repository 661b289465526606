"""Local training of one device's network: who computes it, and on what."""
