"""What `aerofed` offers to Python: runs, sweeps, plans and their tables."""
