"""Flights: plans as missions, the vehicles that fly them, recorded tracks, other programs' logs."""
