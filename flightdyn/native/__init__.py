"""What of navigation is done at every guidance step, in C."""
