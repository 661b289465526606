"""What the autopilot believes: sensors filtered into position, velocity, attitude."""
