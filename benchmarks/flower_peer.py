"""Flower's simulation (on Ray) of the same local training; used where `flwr` is installed.

Processor time of this process (Flower's server) and of Ray's workers (the clients) together,
so that a busy machine does not count; Ray's own daemons are left out. The clients keep their
data between rounds, and the rounds are as long as the paper's, so that what Flower spends on a
round is spread over many steps.
"""

import os
import time
from pathlib import Path

import numpy as np
import torch
from plain_loop import PlainNet, arrays_of, load_arrays, random_loader, train_plainly

from fl.training.networks import ConvNet

ROUNDS = 4


def flower_ms_per_step(net: ConvNet, *, devices: int, samples: int, batch: int) -> float:
    """Median processor milliseconds per device step over the rounds after the first.

    Every round is whole: parameters out, `samples` a device in batches of `batch`, parameters
    back, average.
    """
    cores = os.cpu_count() or 1
    os.environ |= {
        "RAY_worker_niceness": "0",  # Ray's own default is 15
        "RAY_USAGE_STATS_ENABLED": "0",
        "FLWR_TELEMETRY_ENABLED": "0",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[1])]),
    }
    from flwr.client import ClientApp, NumPyClient
    from flwr.common import Context, ndarrays_to_parameters
    from flwr.server import ServerApp, ServerAppComponents, ServerConfig
    from flwr.server.strategy import FedAvg
    from flwr.simulation import run_simulation

    spent: list[float] = []  # processor seconds of all since their start, at each round's end
    workers: dict[int, float] = {}

    class Client(NumPyClient):
        def __init__(self, device: int) -> None:
            torch.set_num_threads(1)
            self.net = PlainNet(net)
            self.loader = random_loader(net, device, samples=samples, batch=batch)

        def fit(self, parameters, config):  # noqa: ARG002  # Flower's interface
            load_arrays(self.net, parameters)
            train_plainly(self.net, self.loader)
            return arrays_of(self.net), samples, {"pid": os.getpid(), "cpu_s": time.process_time()}

    def client_of(context: Context):
        return Client(int(context.node_config["partition-id"])).to_client()

    def round_ended(metrics):
        workers.update({reply["pid"]: reply["cpu_s"] for _, reply in metrics})
        spent.append(time.process_time() + sum(workers.values()))
        return {}

    def server_of(_: Context) -> ServerAppComponents:
        strategy = FedAvg(
            fraction_fit=1.0,
            fraction_evaluate=0.0,
            min_fit_clients=devices,
            min_available_clients=devices,
            initial_parameters=ndarrays_to_parameters(arrays_of(PlainNet(net))),
            fit_metrics_aggregation_fn=round_ended,
        )
        return ServerAppComponents(strategy=strategy, config=ServerConfig(num_rounds=ROUNDS))

    run_simulation(
        ServerApp(server_fn=server_of),
        ClientApp(client_fn=client_of),
        num_supernodes=devices,
        backend_config={
            "client_resources": {"num_cpus": cores, "num_gpus": 0.0},
            "init_args": {"num_cpus": cores},
        },
    )
    return float(1e3 * np.median(np.diff(spent)) * batch / (devices * samples))
