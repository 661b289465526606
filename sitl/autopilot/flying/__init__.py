"""What the aircraft does: modes, orders, missions, routes, manoeuvres."""
