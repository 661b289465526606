"""Who stands where, what they own, how the radio reaches them, and whom a strategy serves."""
