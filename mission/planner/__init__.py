"""Where to fly and whom to serve in one round."""
