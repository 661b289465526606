"""Other programs' flight logs as flights: ULog, DataFlash, telemetry logs; and ours as ULog."""
