"""The runs of a sweep in worker processes: here, or on a Ray cluster."""
