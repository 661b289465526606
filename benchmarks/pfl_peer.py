"""pfl-research's simulation of the same local training; used where `pfl` is installed."""

import time

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812
from pfl.aggregate.simulate import SimulatedBackend
from pfl.algorithm.fedprox import FedProx, FedProxParams
from pfl.callback.base import TrainingProcessCallback
from pfl.data.federated_dataset import FederatedDataset
from pfl.data.pytorch import PyTorchTensorDataset
from pfl.data.sampling import get_user_sampler
from pfl.hyperparam.base import NNTrainHyperParams
from pfl.metrics import Metrics, Weighted
from pfl.model.pytorch import PyTorchModel
from plain_loop import LEARNING_RATE, MOMENTUM, MU, PlainNet, random_loader

from fl.training.networks import ConvNet

ROUNDS = 4


class PflNet(PlainNet):
    """The network as pfl wants it: with its loss and metrics."""

    def loss(self, images: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Mean cross-entropy of a batch."""
        self.train()
        return F.cross_entropy(self(images), labels)

    def metrics(self, images: torch.Tensor, labels: torch.Tensor) -> dict[str, Weighted]:
        """The same, as what an evaluation reports."""
        with torch.no_grad():
            return {"loss": Weighted(float(self.loss(images, labels)) * len(images), len(images))}


class Clock(TrainingProcessCallback):
    """Processor seconds of this process at the end of each round."""

    def __init__(self) -> None:
        self.spent: list[float] = []

    def after_central_iteration(self, aggregate_metrics, model, *, central_iteration):  # noqa: ARG002
        self.spent.append(time.process_time())
        return False, Metrics()


def pfl_ms_per_step(net: ConvNet, *, devices: int, samples: int, batch: int) -> float:
    """Median processor milliseconds per device step over the rounds after the first."""
    torch.set_num_threads(1)
    module = PflNet(net)
    model = PyTorchModel(
        module,
        local_optimizer_create=lambda parameters, lr: torch.optim.SGD(
            parameters, lr=lr, momentum=MOMENTUM
        ),
        central_optimizer=torch.optim.SGD(module.parameters(), lr=1.0),
    )
    loaders = [random_loader(net, k, samples=samples, batch=batch) for k in range(devices)]
    users = {k: loader.dataset.tensors for k, loader in enumerate(loaders)}
    data = FederatedDataset(
        lambda user: PyTorchTensorDataset(users[user], user_id=str(user)),
        get_user_sampler("minimize_reuse", list(users)),
    )
    clock = Clock()
    FedProx().run(
        FedProxParams(
            central_num_iterations=ROUNDS,
            evaluation_frequency=1000,
            train_cohort_size=devices,
            val_cohort_size=None,
            mu=MU,
        ),
        SimulatedBackend(data, data),
        model,
        NNTrainHyperParams(
            local_num_epochs=1, local_learning_rate=LEARNING_RATE, local_batch_size=batch
        ),
        callbacks=[clock],
        send_metrics_to_platform=False,
    )
    return float(1e3 * np.median(np.diff(clock.spent)) * batch / (devices * samples))
