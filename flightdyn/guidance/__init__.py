"""From orders to thrust: paths, trajectories, control."""
