"""What is done at every tick, and what of navigation at every guidance step, in C."""
