"""What the aircraft does: orders, missions, routes, manoeuvres."""
