"""Pilots outside the vehicle: programs with setpoints, sticks, a target to follow."""
