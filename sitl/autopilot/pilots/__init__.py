"""Everybody outside who may fly the vehicle: programs, sticks, a target to follow."""
