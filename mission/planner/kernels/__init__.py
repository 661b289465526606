"""Compiled inner loops. Plain arrays in, plain arrays out."""
