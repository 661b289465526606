"""Other programs' flight logs as flights: ULog, DataFlash, telemetry logs; and missions in logs."""
