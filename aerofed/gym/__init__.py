"""Gymnasium environments: a vehicle steered by setpoints, and a round decided stop by stop.

import aerofed.gym
import gymnasium

gymnasium.make("aerofed/Setpoint-v0", wind_mps=6)
gymnasium.make("aerofed/Round-v0")
"""

try:
    import gymnasium
except ModuleNotFoundError:
    raise ImportError(
        "aerofed.gym: Gymnasium is not installed: pip install 'aerofed[gym]'"
    ) from None

gymnasium.register("aerofed/Setpoint-v0", "aerofed.gym.setpoint:SetpointEnv", max_episode_steps=200)
gymnasium.register("aerofed/Round-v0", "aerofed.gym.round:RoundEnv")
