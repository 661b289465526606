"""The flight log: an MCAP file that every reader of the format opens, and the way back from it.

`writer` records a run, `reader` gives it back as values, `recover` saves what a killed run had
flushed, `live` serves the same topics over a Foxglove WebSocket while the run goes on.
"""
