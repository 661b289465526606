"""Communities of devices, and the rounds in which their models become one."""
