"""Steps that environments make: ours, and peers' in the same run.

    python benchmarks/gym_steps.py [--peer PYTHON]

PYTHON is an interpreter of an environment with `pip install crazyflow`, whose drones fly by a model
that is fitted to attitude commands, in JAX, on the truth: no sensors, no estimate, no autopilot. A
step of any drone here is 0.1 s of flight. Rates are by CPU second, of one process at a time.
"""

import argparse
import subprocess
import time

import gymnasium

import aerofed.gym

STEPS = 1000
PEER = """
import sys, time, warnings
warnings.filterwarnings("ignore")
import gymnasium, jax, crazyflow, crazyflow.envs
count = int(sys.argv[1])
env = gymnasium.make_vec("DroneReachVel-v0", num_envs=count, freq=10, max_episode_time=1e9)
env.reset(seed=1)
env.action_space.seed(1)
action = env.action_space.sample()
action[:, :3] = 0.0
jax.block_until_ready(env.step(action)[0]["pos"])
steps = max(100, 20000 // count)
began_s = time.process_time()
for _ in range(steps):
    seen, *_ = env.step(action)
jax.block_until_ready(seen["pos"])
print(count * steps / (time.process_time() - began_s))
"""


def rate(name: str, steps: int = STEPS, **options: object) -> tuple[float, float]:
    """Steps a CPU second within episodes, and CPU seconds of a reset."""
    env = gymnasium.make(name, disable_env_checker=True, **options)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(steps)]
    env.reset(seed=1)
    resets, reset_s, began_s = 0, 0.0, time.process_time()
    for action in actions:
        *_, over, cut, _ = env.step(action)
        if over or cut:
            at_s = time.process_time()
            env.reset()
            resets, reset_s = resets + 1, reset_s + time.process_time() - at_s
    return steps / (time.process_time() - began_s - reset_s), reset_s / max(1, resets)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--peer", help="a Python with crazyflow")
    peer = parser.parse_args().peer
    gymnasium.register_envs(aerofed.gym)
    print(f"{'environment':44}{'steps/CPU s':>12}{'flown s/CPU s':>15}{'reset, CPU ms':>15}")
    for name, step_s in (
        ("CartPole-v1", 0.0),
        ("aerofed/Round-v0", 0.0),
        ("aerofed/Setpoint-v0", 0.1),
    ):
        steps, reset_s = rate(name)
        flown = f"{steps * step_s:15.0f}" if step_s else " " * 15
        print(f"{name:44}{steps:12.0f}{flown}{1e3 * reset_s:15.2f}")
    for count in (1, 64, 1024) if peer else ():
        command = [peer, "-c", PEER, str(count)]
        ended = subprocess.run(command, capture_output=True, text=True, check=True)
        steps = float(ended.stdout.split()[-1])
        print(f"{f'crazyflow DroneReachVel-v0, {count} drones':44}{steps:12.0f}{steps * 0.1:15.0f}")


if __name__ == "__main__":
    main()
