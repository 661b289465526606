"""The flight log: an MCAP file that every reader of the format opens, and the way back from it.

`writer` records a run, `reader` gives it back as values, `contents` saves what a
killed run had flushed, `live` serves the same topics to Foxglove while the run goes on.
"""
