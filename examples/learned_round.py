"""A small policy that learns to fly rounds, beside the certified planner.

    pip install '.[gym]'    # in the clone
    python examples/learned_round.py [GENERATIONS POLICIES ROUNDS]

The cross-entropy method: draw policies around the present one, let each fly the same rounds, go on
from the mean of the best, and draw ever nearer. It is tested on rounds that it has never seen.
"""

import sys

import gymnasium
import numpy as np

import aerofed.gym

SEEN = 8  # what is seen of a device, of which three linear functions decide


def action(weights, seen):
    """Where to go and who sends: to the device that is liked best, part of the way."""
    places, here, waits = seen["devices"], seen["position"], seen["asked"] == 0
    away = np.hypot(*(places - here).T)
    apart = np.hypot(*(places[:, None] - places[None]).T)
    (stops, metres), ones = seen["left"][:2], np.ones(len(places))
    importance, near = seen["importance"], np.exp(-4.0 * apart) @ waits / 3.0
    inputs = importance / importance.max(), away, near, metres * ones, stops * ones
    liked, share, send = weights @ [*inputs, away * metres, away * stops, ones]
    to = np.where(waits, liked, -np.inf).argmax()
    place = here + (places[to] - here) / (1.0 + np.exp(-share[to]))
    return np.clip(np.concatenate((place, send)), -1.0, 1.0)


def value(env, weights, seed):
    """What a round is worth that the policy flies: the mean of what arrives."""
    (seen, _), worth, over = env.reset(seed=seed), 0.0, False
    while not over:
        seen, _, over, _, info = env.step(action(weights.reshape(3, SEEN), seen))
        worth += info["expected"]
    return worth


if __name__ == "__main__":
    generations, policies, rounds = map(int, sys.argv[1:] or (40, 48, 16))
    env = gymnasium.make("aerofed/Round-v0", disable_env_checker=True)
    rng, mean, spread = np.random.default_rng(1), np.zeros(3 * SEEN), np.ones(3 * SEEN)
    for generation in range(generations):
        drawn = mean + spread * rng.standard_normal((policies, 3 * SEEN))
        seeds = rng.integers(10**6, size=rounds).tolist()
        worth = [np.mean([value(env, policy, seed) for seed in seeds]) for policy in drawn]
        best = drawn[np.argsort(worth)[-max(1, policies // 6) :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + max(0.02, 0.3 - generation / 100)
        print(f"generation {generation + 1}: {np.mean(worth):.3f} a round on average")
    rows = []
    for seed in range(10**6, 10**6 + 30):
        learned, plan = value(env, mean, seed), aerofed.plan(env.unwrapped.problem)
        rows.append((learned, plan.value, plan.upper_bound))
    learned, planned, bound = np.mean(rows, axis=0)
    print(f"30 other rounds: learned {learned:.3f}, certified {planned:.3f}, bound {bound:.3f}")
