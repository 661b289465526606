"""The aircraft: physics, sensors, estimation and control. No asyncio, sockets or wall clock."""
