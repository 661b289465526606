"""What the runs of a sweep add up to: curves, gains, tables, figures."""
