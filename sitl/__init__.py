"""The vehicle as MAVLink sees it: autopilot, links and the pace of simulated time."""
