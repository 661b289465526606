"""Compiled inner loops (the home of numba). Plain arrays in, plain arrays out."""
