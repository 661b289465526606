"""A small policy that learns to fly rounds, beside the certified planner.

    pip install 'aerofed[gym]'
    python examples/learned_round.py

The cross-entropy method: draw policies around the present one, let each fly the same rounds, go on
from the mean of the best, and draw ever nearer. Every round has its devices elsewhere. The policy
is tested on rounds that it has never seen, which the planner plans, too.
"""

import argparse
import time

import gymnasium
import numpy as np

import aerofed
import aerofed.gym

SEEN = 8  # what is seen of a device, of which three linear functions decide


def action(weights, seen):
    """Where to go and who sends: to the device that is liked best, part of the way."""
    places, here, waits = seen["devices"], seen["position"], seen["asked"] == 0
    away = np.hypot(*(places - here).T)
    apart = np.hypot(*(places[:, None] - places[None]).T)
    (stops, metres), ones = seen["left"][:2], np.ones(len(places))
    inputs = np.stack((
        seen["importance"] / seen["importance"].max(), away, np.exp(-4.0 * apart) @ waits / 3.0,
        metres * ones, stops * ones, away * metres, away * stops, ones,
    ))  # fmt: skip
    liked, share, send = weights.reshape(3, SEEN) @ inputs
    to = np.where(waits, liked, -np.inf).argmax()
    place = here + (places[to] - here) / (1.0 + np.exp(-share[to]))
    return np.clip(np.concatenate((place, send)), -1.0, 1.0)


def value(env, weights, seed):
    """What a round is worth that the policy flies: the mean of what arrives."""
    seen, _ = env.reset(seed=seed)
    worth, over = 0.0, False
    while not over:
        seen, _, over, _, info = env.step(action(weights, seen))
        worth += info["expected"]
    return worth


def main():
    """Train, test, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--generations", type=int, default=40)
    parser.add_argument("--policies", type=int, default=48)
    parser.add_argument("--rounds", type=int, default=16)
    given = parser.parse_args()
    gymnasium.register_envs(aerofed.gym)
    env = gymnasium.make("aerofed/Round-v0", disable_env_checker=True)
    rng = np.random.default_rng(1)
    mean, spread, began_s = np.zeros(3 * SEEN), np.ones(3 * SEEN), time.perf_counter()
    best = max(1, given.policies // 6)
    for generation in range(given.generations):
        drawn = mean + spread * rng.standard_normal((given.policies, 3 * SEEN))
        seeds = rng.integers(10**6, size=given.rounds).tolist()
        worth = [np.mean([value(env, weights, seed) for seed in seeds]) for weights in drawn]
        chosen = drawn[np.argsort(worth)[-best:]]
        mean, spread = (
            chosen.mean(axis=0),
            chosen.std(axis=0) + max(0.02, 0.3 - generation / 100),
        )
        if generation % 10 == 9:
            print(f"generation {generation + 1}: {np.mean(worth):.3f} a round on average")
    print(f"trained in {time.perf_counter() - began_s:.0f} s")
    rows = []
    for seed in range(10**6, 10**6 + 30):
        learned = value(env, mean, seed)
        plan = aerofed.plan(env.unwrapped.problem)
        rows.append((learned, plan.value, plan.upper_bound))
    learned, planned, bound = np.mean(rows, axis=0)
    print(f"30 other rounds: learned {learned:.3f}, certified {planned:.3f}, bound {bound:.3f}")


if __name__ == "__main__":
    main()
