"""Who is served at which step where steps are too few for all: the optimal assignment.

Shortest augmenting paths with prices (Jonker and Volgenant 1987) between steps of `per_step`
places each and a place outside for everybody. Devices come one after the other, the best first:
one whose best step has room takes it. Otherwise the cheapest chain of displacements is searched,
which ends at a step with room or at a device better left out. Most chains are two or three steps
long, so that few of the worths are ever worked out.
"""

import math
from typing import NamedTuple

import numpy as np

from mission.planner.kernels.compiled import Flags, Indices, Matrix, Vector, compiled
from mission.planner.kernels.instance import Devices
from mission.planner.kernels.rewards import reward


class Places(NamedTuple):
    """Memory for the assignment of K devices to N steps of P places."""

    worth: Matrix  # (K, N)
    known: Flags  # (K,) whose worths are worked out
    order: Indices  # (K,)
    sorted: Indices  # (K,)
    price: Vector  # (N,)
    load: Indices  # (N,)
    held: Indices  # (N, P) the devices at each step
    # Least loss of freeing a place for the new device by ending the chain at a step, and the
    # device that moves there then.
    reached: Vector  # (N,)
    taker: Indices  # (N,)
    settled: Flags  # (N,)
    who: Indices  # (P,)


def make_places(devices: int, steps: int, per_step: int) -> Places:
    """Memory for problems of that size."""
    places = min(per_step, devices)
    return Places(
        np.zeros((devices, steps)),
        np.zeros(devices, dtype=np.bool_),
        np.zeros(devices, dtype=np.int64),
        np.zeros(devices, dtype=np.int64),
        np.zeros(steps),
        np.zeros(steps, dtype=np.int64),
        np.zeros((steps, places), dtype=np.int64),
        np.zeros(steps),
        np.zeros(steps, dtype=np.int64),
        np.zeros(steps, dtype=np.bool_),
        np.zeros(places, dtype=np.int64),
    )


@compiled
def descending(values: Vector, order: Indices, merged: Indices) -> Indices:
    """Indices of the values (K,) from the largest to the least, equal ones in order.

    A merge sort from the bottom up, in the memory of `order` and `merged` (K,).
    """
    count = values.shape[0]
    for k in range(count):
        order[k] = k
    width = 1
    while width < count:
        for first in range(0, count, 2 * width):
            middle, last = min(first + width, count), min(first + 2 * width, count)
            i, j = first, middle
            for k in range(first, last):
                if j == last or (i < middle and values[order[i]] >= values[order[j]]):
                    merged[k] = order[i]
                    i += 1
                else:
                    merged[k] = order[j]
                    j += 1
        order, merged = merged, order
        width *= 2
    return order


@compiled
def solve_assignment(
    way: Matrix, per_step: int, devices: Devices, best: Vector, assigned: Indices, room: Places
) -> None:
    """Write the step of every device into `assigned` (K,), -1 where it is not served.

    `best` (K,) is what each earns at its best step, or less than nothing to leave it out.
    """
    steps, count = way.shape[0], devices.u.shape[0]
    places = min(per_step, count)
    worth, known, price, load, held = room.worth, room.known, room.price, room.load, room.held
    reached, taker, settled, who = room.reached, room.taker, room.settled, room.who
    for k in range(count):
        assigned[k], known[k] = -1, False
    for n in range(steps):
        price[n], load[n] = 0.0, 0
    order = descending(best, room.order, room.sorted)
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
