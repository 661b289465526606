"""MAVLink's microservices from the vehicle's side, without I/O and without a clock."""
