"""A long search to measure the planner against: simulated annealing on stops and visiting order.

It shares nothing with the planner but the problem. Stops are points anywhere; a move shifts a
stop, takes it elsewhere (to a random device, on the cheapest leg), or reverses a stretch of the
order. Each stop serves the K_bar devices that gain most by it and takes them from other stops;
what it leaves behind goes to the nearest stop with room. A path too long pays for each metre.
Annealing starts over from random stops, with twice the moves each time, until the CPU seconds are
spent; the path of each is shrunk onto L_max, assigned optimally, and polished by the sequential
quadratic programs of `sqp`.
"""

import math
import time

import numpy as np
from numba import njit

from fl.radio.channel import average_per
from mission.planner.arrays import instance
from mission.planner.evaluate import finish, fit_budget
from mission.planner.problem import Floats, RoundPlan, RoundProblem
from mission.planner.sqp import ascend

CELL_M = 25.0
NEAREST = 40  # devices that a stop looks at
FIRST_MOVES = 2_000_000
GROWTH = 2
TOO_LONG = 4.0  # a metre too much costs so many times what a metre brings on average


def search(problem: RoundProblem, seconds: float, *, seed: int = 1) -> tuple[RoundPlan, int]:
    """(the best plan found in that many CPU seconds, moves made)."""
    began = time.process_time()
    u = problem.devices_m - problem.start_m
    grid = _grid(u)
    table = 1.0 - average_per(problem.channel, np.arange(0.0, 4000.0))
    best: RoundPlan | None = None
    moves, total = FIRST_MOVES, 0
    rng = np.random.default_rng(seed)
    spent = 0.0
    while best is None or spent < seconds:
        if best is not None:  # as many moves as the time left allows
            moves = min(moves * GROWTH, int(1.02 * total * (seconds - spent) / spent) + 1000)
        way = np.zeros((problem.steps, 2))
        pick = rng.integers(0, len(u), problem.steps - 1)
        way[1:] = u[pick] * min(1.0, problem.path_budget_m / (60.0 * problem.steps))
        value = float(problem.importance.max() * table[0] * problem.per_step)
        found = _anneal(
            u, problem.importance, table, *grid, problem.per_step, problem.path_budget_m, way,
            moves, 0.05 * value, 1e-5 * value, rng,
        )  # fmt: skip
        total += moves
        found = ascend(fit_budget(found, problem.path_budget_m), *instance(problem))
        plan = finish(problem, fit_budget(problem.start_m + found, problem.path_budget_m))
        if best is None or plan.value > best.value:
            best = plan
        spent = time.process_time() - began
    return best, total


def _grid(u: Floats) -> tuple[np.ndarray, Floats, int, int]:
    """For each cell the devices nearest to its middle."""
    low = u.min(axis=0) - CELL_M
    cells = np.ceil((u.max(axis=0) + CELL_M - low) / CELL_M).astype(int)
    x, y = (low[i] + CELL_M * (np.arange(cells[i]) + 0.5) for i in range(2))
    middle = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    distance = np.hypot(*(middle[:, None] - u).transpose(2, 0, 1))
    lists = np.argsort(distance, axis=1, kind="stable")[:, :NEAREST]
    return np.ascontiguousarray(lists), low, int(cells[0]), int(cells[1])


@njit(cache=True)
def _earns(k, x, y, u, delta, table):
    r = math.sqrt((x - u[k, 0]) ** 2 + (y - u[k, 1]) ** 2)
    i = int(r)
    if i + 1 >= table.shape[0]:
        return 0.0
    return delta[k] * (table[i] + (r - i) * (table[i + 1] - table[i]))


@njit(cache=True)
def _leg(order, way, i, j):
    """Metres between the stops at two positions; 0 past the end."""
    if j >= order.shape[0]:
        return 0.0
    a, b = order[i], order[j]
    return math.sqrt((way[a, 0] - way[b, 0]) ** 2 + (way[a, 1] - way[b, 1]) ** 2)


@njit(cache=True)
def _to(x, y, order, way, j):
    if j >= order.shape[0]:
        return 0.0
    b = order[j]
    return math.sqrt((x - way[b, 0]) ** 2 + (y - way[b, 1]) ** 2)


@njit(cache=True)
def _anneal(u, delta, table, lists, low, columns, rows, places, length, way, moves, hot, cold, rng):
    steps, count = way.shape[0], u.shape[0]
    order = np.arange(steps)  # by position: stop
    have, at = np.zeros(count), np.full(count, -1)
    serves = np.full((steps, places), -1)
    kept_order, kept_way, best = order.copy(), way.copy(), -1.0
    top, pick, given = np.zeros(places), np.full(places, -1), np.full(places, -1)
    had = np.zeros(places)
    value, metres = 0.0, 0.0
    for i in range(1, steps):
        metres += _leg(order, way, i - 1, i)
    heat = hot
    for move in range(-steps, moves):
        # The first turns give every stop, the start included, its devices.
        setup = move < 0
        if not setup and move % 1000 == 0:
            heat = hot * (cold / hot) ** (move / moves)
        dear = TOO_LONG * max(value, 1e-12) / length
        z = 1.0 if setup else rng.random()
        if z < 0.15:
            a, b = rng.integers(1, steps), rng.integers(1, steps)
            if a > b:
                a, b = b, a
            change = 0.0
            if b + 1 < steps:
                change = _leg(order, way, a, b + 1) - _leg(order, way, b, b + 1)
            change += _leg(order, way, a - 1, b) - _leg(order, way, a - 1, a)
            cost = dear * (max(0.0, metres + change - length) - max(0.0, metres - length))
            if cost <= 0.0 or rng.random() < math.exp(-cost / heat):
                metres += change
                while a < b:
                    order[a], order[b] = order[b], order[a]
                    a += 1
                    b -= 1
            continue
        i = move + steps if setup else rng.integers(1, steps)
        n = order[i]
        x, y = way[n, 0], way[n, 1]
        to, change = i, 0.0
        if z < 0.5 and steps > 2:
            k = rng.integers(0, count)
            x, y = u[k, 0] + 15.0 * rng.normal(), u[k, 1] + 15.0 * rng.normal()
            change = -_leg(order, way, i - 1, i) - _leg(order, way, i, i + 1)
            if i + 1 < steps:
                change += _leg(order, way, i - 1, i + 1)
            least = math.inf
            for j in range(steps):  # behind position j
                if j == i:
                    continue
                after = j + 1 if j + 1 != i else i + 1
                detour = _to(x, y, order, way, j) + _to(x, y, order, way, after)
                if after < steps:
                    detour -= _leg(order, way, j, after)
                if detour < least:
                    least, to = detour, j
            change += least
            to = to if to > i else to + 1
        elif not setup:
            wide = 0.5 * 100.0 ** rng.random()
            x, y = x + wide * rng.normal(), y + wide * rng.normal()
            change = _to(x, y, order, way, i - 1) + _to(x, y, order, way, i + 1)
            change -= _leg(order, way, i - 1, i) + _leg(order, way, i, i + 1)
        # What the stop serves now is set free, and it takes what gains most at its new place.
        gain = 0.0
        for p in range(places):
            k = serves[n, p]
            if k >= 0:
                had[p] = have[k]
                gain -= have[k]
                have[k] = 0.0
        cx = min(columns - 1, max(0, int((x - low[0]) / CELL_M)))
        cy = min(rows - 1, max(0, int((y - low[1]) / CELL_M)))
        top[:] = 0.0
        pick[:] = -1
        for e in range(lists.shape[1]):
            k = lists[cx * rows + cy, e]
            more = _earns(k, x, y, u, delta, table) - have[k]
            if more > top[0]:
                p = 0
                while p + 1 < places and top[p + 1] < more:
                    top[p], pick[p] = top[p + 1], pick[p + 1]
                    p += 1
                top[p], pick[p] = more, k
        for p in range(places):
            gain += top[p]
        # What it leaves goes to the nearest stop with room, one a stop.
        given[:] = -1
        for p in range(places):
            k = serves[n, p]
            if k < 0:
                continue
            for q in range(places):
                if pick[q] == k:
                    k = -1
                    break
            if k < 0:
                continue
            least, where = math.inf, -1
            for s in range(steps):
                square = (way[s, 0] - u[k, 0]) ** 2 + (way[s, 1] - u[k, 1]) ** 2
                if s != n and square < least:
                    room = False
                    for q in range(places):
                        room = room or serves[s, q] < 0
                    for q in range(places):
                        room = room and given[q] != s
                    if room:
                        least, where = square, s
            if where >= 0:
                given[p] = where
                gain += _earns(k, way[where, 0], way[where, 1], u, delta, table)
        cost = dear * (max(0.0, metres + change - length) - max(0.0, metres - length))
        if setup or gain >= cost or rng.random() < math.exp((gain - cost) / heat):
            for p in range(places):
                k = serves[n, p]
                serves[n, p] = -1
                if k >= 0:
                    at[k] = -1
                    if given[p] >= 0:
                        for q in range(places):
                            s = given[p]
                            if serves[s, q] < 0:
                                serves[s, q], at[k] = k, s
                                have[k] = _earns(k, way[s, 0], way[s, 1], u, delta, table)
                                break
            way[n, 0], way[n, 1] = x, y
            for p in range(places):
                k = pick[p]
                if k >= 0:
                    if at[k] >= 0:
                        for q in range(places):
                            if serves[at[k], q] == k:
                                serves[at[k], q] = -1
                    serves[n, p], at[k] = k, n
                    have[k] = _earns(k, x, y, u, delta, table)
            value += gain
            metres += change
            if to != i:
                step = 1 if to > i else -1
                while i != to:
                    order[i] = order[i + step]
                    i += step
                order[i] = n
            if metres <= length and value > best * (1.0 + 1e-6) and 2 * move > moves:
                best = value
                kept_order[:] = order
                kept_way[:] = way
        else:
            for p in range(places):
                k = serves[n, p]
                if k >= 0:
                    have[k] = had[p]
    if best < 0.0:
        kept_order[:] = order
        kept_way[:] = way
    result = np.empty_like(way)
    for i in range(steps):
        result[i] = kept_way[kept_order[i]]
    return result
