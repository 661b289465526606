"""What is watched, and what the vehicle does by itself when something is wrong."""
