"""Real PX4 and ArduPilot firmware as the autopilot of our simulated aircraft.

A bridge sends the plant's sensor readings to a firmware and drives the plant's motors as it orders,
tick by tick, in the firmware's own simulator protocol; the firmware runs on our clock.
"""
