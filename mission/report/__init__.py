"""The report of a run: one HTML file that needs nothing else, on a desk or on a phone."""
