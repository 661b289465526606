"""Who is served at which step where steps are too few for all: the optimal assignment.

Shortest augmenting paths with prices (Jonker and Volgenant 1987) between steps of `per_step`
places each and a place outside for everybody. Devices come one after the other, the best first:
one whose best step has room takes it. Otherwise the cheapest chain of displacements is searched,
which ends at a step with room or at a device better left out. Most chains are two or three steps
long, so that few of the worths are ever worked out.
"""

import math

import numpy as np

from mission.planner.kernels.compiled import Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices
from mission.planner.kernels.rewards import reward


@compiled
def solve_assignment(
    way: Matrix, per_step: int, devices: Devices, best: Vector, assigned: Indices
) -> None:
    """Write the step of every device into `assigned` (K,), -1 where it is not served.

    `best` (K,) is what each earns at its best step, or less than nothing to leave it out.
    """
    steps, count = way.shape[0], devices.u.shape[0]
    places = min(per_step, count)
    worth, known = np.empty((count, steps)), np.zeros(count, dtype=np.bool_)
    price, load = np.zeros(steps), np.zeros(steps, dtype=np.int64)
    held = np.empty((steps, places), dtype=np.int64)  # the devices at each step
    # Least loss of freeing a place for the new device by ending the chain at a step, and the
    # device that moves there then.
    reached, taker = np.empty(steps), np.empty(steps, dtype=np.int64)
    settled, who = np.empty(steps, dtype=np.bool_), np.empty(places, dtype=np.int64)
    assigned[:] = -1
    order = np.argsort(-best, kind="mergesort")
    cheapest = 0.0
    for i in range(count):
        new = order[i]
        if best[new] <= cheapest:
            break  # no place is worth its price for this device, nor for any after it
        for n in range(steps):
            reached[n], settled[n] = math.inf, False
        # What the chain has lost when the devices in question are taken from where they are.
        lost, here = 0.0, -1
        who[0], size = new, 1
        out, loss_out, end = new, math.inf, -1
        while True:
            for m in range(size):
                k = who[m]
                if not known[k]:
                    known[k] = True
                    for n in range(steps):
                        dx, dy = way[n, 0] - devices.u[k, 0], way[n, 1] - devices.u[k, 1]
                        f = reward(math.sqrt(dx * dx + dy * dy), devices.rows)[0]
                        worth[k, n] = devices.delta[k] * f
                profit = 0.0
                if here >= 0:
                    profit = worth[k, here] - price[here]
                else:
                    for n in range(steps):
                        profit = max(profit, worth[k, n] - price[n])
                loss = lost + profit
                if loss < loss_out:
                    out, loss_out = k, loss
                for n in range(steps):
                    moved = loss - worth[k, n] + price[n]
                    if moved < reached[n] and not settled[n]:
                        reached[n], taker[n] = moved, k
            here, lost = -1, loss_out
            for n in range(steps):
                if not settled[n] and reached[n] < lost:
                    here, lost = n, reached[n]
            if here < 0:
                break
            if load[here] < places:
                end = here
                break
            settled[here] = True
            size = places
            for m in range(places):
                who[m] = held[here, m]
        total = loss_out if end < 0 else reached[end]
        cheapest = math.inf
        for n in range(steps):
            if settled[n]:
                price[n] += total - reached[n]
            cheapest = min(cheapest, price[n])
        if end < 0 and out == new:
            continue
        if end < 0:
            end = assigned[out]
            slot = _slot(held, end, out)
            assigned[out] = -1
        else:
            slot = load[end]
            load[end] += 1
        # Back along the chain: each device moves on into the place of the one after it.
        k = taker[end]
        while True:
            before = assigned[k]
            held[end, slot], assigned[k] = k, end
            if k == new:
                break
            slot, end = _slot(held, before, k), before
            k = taker[end]


@compiled
def _slot(held: Indices, step: int, device: int) -> int:
    """The place of a device among those of its step."""
    slot = 0
    while held[step, slot] != device:
        slot += 1
    return slot
