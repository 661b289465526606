"""Everything that the libraries do, on data from seeds; prints a digest of what comes out."""

import hashlib
import socket
import sys

import numpy as np

from fl.config import ConvNetConfig
from fl.data.dataset import Split
from fl.native.library import normal_shares
from fl.radio.channel import CHANNEL_PRESETS
from fl.training.local import LocalSettings, LocalTask, scaling_of
from fl.training.models import make_network
from mission.planner.certified import CertifiedPlanner
from mission.planner.problem import RoundProblem
from sitl.firmware.native import library as bridge

digest = hashlib.sha256()
rng = np.random.Generator(np.random.PCG64(3))


def learn(name, shape, dtype, count, convnet=None):
    net = make_network(name, convnet=convnet, image_shape=shape, classes=10)
    pixels = rng.integers(0, 256, (count, *shape)).astype(dtype)
    split = Split(pixels, rng.integers(0, 10, count))
    scaling, model = scaling_of(split), net.initial(rng)
    correction = rng.normal(0.0, 1e-3, model.shape).astype(np.float32)
    for extra in (None, correction):
        task = LocalTask(np.arange(count), np.random.Generator(np.random.PCG64(1)), extra)
        settings = LocalSettings(0.05, 0.9, 0.1, 20, 1)
        (result,) = net.train(split, model, [task], scaling=scaling, settings=settings)
        digest.update(result.model.tobytes())
        digest.update(np.float64(result.loss).tobytes())
        digest.update(net.correct_per_class(split, result.model, scaling=scaling).tobytes())


def plan(channel, devices, steps, per_step):
    problem = RoundProblem(
        rng.uniform(0.0, 800.0, (devices, 2)), rng.uniform(0.5, 1.5, devices),
        rng.uniform(0.0, 800.0, 2), steps, per_step, 700.0, CHANNEL_PRESETS[channel],
    )  # fmt: skip
    made = CertifiedPlanner(max_nodes=60).plan(problem)
    digest.update(made.waypoints_m.tobytes())
    digest.update(made.schedule.tobytes())
    digest.update(np.array([made.value, made.upper_bound, made.nodes]).tobytes())


def hil(ticks):
    """PX4's stream, in which anything may come at any time."""
    ours, theirs = socket.socketpair()
    link = bridge.Hil(socket=ours.fileno())
    at = bridge.address_of(link)
    for tick in range(1, ticks):
        bridge.put_inertial(link, 0, tick, *rng.normal(0.0, 3.0, 6))
        bridge.hil_send(at, rng.bytes(36) if tick % 5 == 0 else None)
        digest.update(theirs.recv(65536))
        junk = bytearray(rng.bytes(int(rng.integers(1, 700))))
        for marker in rng.integers(0, len(junk), 5):
            junk[marker] = 0xFD
        theirs.sendall(junk)
        bridge.hil_wait(at, False)
        digest.update(bytes(link)[: bridge.Hil.socket.offset])


def json(ticks):
    """ArduPilot's datagrams, of whatever length."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    link = bridge.Json(socket=ours.fileno())
    at = bridge.address_of(link)
    for _ in range(ticks):
        bridge.put_state(link, 0, *rng.normal(0.0, 10.0 ** rng.integers(-9, 300), 16))
        bridge.json_send(at)
        digest.update(theirs.recv(65536))
        theirs.send(rng.bytes(int(rng.integers(1, 300))))
        theirs.send(b"\x1a\x48" + rng.bytes(38))
        for _ in range(2):
            digest.update(bytes((bridge.json_wait(at),)))
        digest.update(bytes(link)[: bridge.Json.socket.offset])


hil(300)
json(300)
learn("lenet", (12, 12, 3), np.uint8, 30)
learn("lenet", (9, 11, 1), np.float32, 21)
learn("mcmahan", (4, 5, 1), np.uint8, 17)
learn("convnet", (9, 8, 2), np.uint8, 18, ConvNetConfig(channels=(5, 3, 6), hidden=(7, 9)))
learn("convnet", (3, 4, 1), np.float32, 18, ConvNetConfig(channels=(), hidden=()))
plan("suburban", 12, 8, 3)
plan("high-rise", 9, 4, 1)
plan("suburban+10dB", 45, 10, 2)
digest.update(normal_shares(np.linspace(-40.0, 40.0, 4001)).tobytes())
sys.stdout.write(digest.hexdigest())
