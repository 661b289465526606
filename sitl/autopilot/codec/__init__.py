"""MAVLink bytes and units: the one home of pymavlink. Inside it degE7, mm and cm/s; outside SI."""
