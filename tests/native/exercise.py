"""Everything that the libraries do, on data from seeds; prints a digest of what comes out."""

import hashlib
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
