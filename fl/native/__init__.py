"""Native training of the built-in networks: arrays in, arrays out."""
