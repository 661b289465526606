"""The airframe: JSBSim's files and the numbers of them that the autopilot knows."""
