"""Gains of a guidance that flies a vehicle of no particular kind, every 20 ms."""

DT_S = 0.02
GAINS = {
    "dt": DT_S, "gravity": 9.81, "full": 41.5, "slope": 1.7, "idle": 0.05, "position": 1.6,
    "velocity": 4.5, "integral": 2.5, "integral_limit": 6.0, "lead": 0.16, "drag_lag": 0.1,
    "drag_limit": 12.0, "thrust_lag": 0.25, "motor_lag": 0.06, "most_thrust": 0.9, "yaw_rate": 1.0,
}  # fmt: skip
