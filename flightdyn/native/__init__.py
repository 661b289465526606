"""C code of a flight, run at every tick and guidance step, and its interface."""
