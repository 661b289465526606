"""Vehicles as MAVSDK sees them: the one home of mavsdk.

A pilot knows its vehicle only by MAVLink. It gives an order, waits until telemetry says that it
was carried out, and gives up when the vehicle falls silent. Wall time is read by its watchdog
alone, which may end a flight but never alters one.
"""
