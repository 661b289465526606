"""Compiled training of the built-in networks (the home of numba): arrays in, arrays out."""
