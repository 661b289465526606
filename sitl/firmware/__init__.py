"""Other people's autopilots as the brain of our aircraft: real PX4 and ArduPilot firmware.

A bridge hands a firmware the sensors of the plant and drives the plant's motors as it says, tick
by tick, in the firmware's own simulator protocol; the firmware's clock is ours.
"""
