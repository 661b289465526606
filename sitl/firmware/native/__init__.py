"""The ends of the firmwares' simulator protocols: what is sent and read at every tick."""
