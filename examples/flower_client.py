"""A Flower ClientApp trains the devices: what it is sent, and what it answers, is Flower's.

The message has the model's arrays and the settings of the round; the context, as the node's own,
the device's samples (`data`: x, y). The algorithm is any of ours, or Flower's: flower.py.

    pip install 'aerofed[flower]'
    aerofed run --set learning.trainer=examples.flower_client:make learning.algorithm=fedavg \
        communities.{0,1}.network=convnet communities.{0,1}.convnet.channels=[]
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from flwr.app import ArrayRecord, ConfigRecord, Context, Message, MetricRecord, RecordDict
from flwr.clientapp import ClientApp
from torch.nn.functional import cross_entropy, linear

from mission.api import LearningConfig, LocalResult

app = ClientApp()


@app.train()
def train(message: Message, context: Context) -> Message:
    """Yours in its place: this one trains dense layers by SGD."""
    arrays, how = message.content["arrays"].to_numpy_ndarrays(), message.content["config"]
    layers = [torch.tensor(array, requires_grad=True) for array in arrays]
    x, y = (torch.tensor(array) for array in context.state["data"].to_numpy_ndarrays())
    optimiser, losses = torch.optim.SGD(layers, how["lr"], how["momentum"]), []
    for batch in (
        b for _ in range(how["epochs"]) for b in torch.randperm(len(y)).split(how["batch"])
    ):
        z = x[batch].flatten(1)
        for weight, bias in zip(layers[::2], layers[1::2], strict=True):
            z = linear(z.relu() if weight is not layers[0] else z, weight, bias)
        losses.append(loss := cross_entropy(z, y[batch]))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    sent = ArrayRecord([layer.detach().numpy() for layer in layers])
    metrics = MetricRecord({"train_loss": float(sum(losses)) / len(losses), "steps": len(losses)})
    return Message(RecordDict({"arrays": sent, "metrics": metrics}), reply_to=message)


@dataclass(frozen=True)
class FlowerTrainer:
    """Hands a device's round to the app. Its context lasts for that round."""

    app: ClientApp

    def train(self, device, model, data, rng):
        ends = np.cumsum([0, *(int(np.prod(shape)) for shape in device.shapes)])
        parts = [
            model[a:b].reshape(s) for (a, b), s in zip(pairwise(ends), device.shapes, strict=True)
        ]
        torch.manual_seed(seed := int(rng.integers(2**31)))
        s, node = device.settings, device.device + 1
        how = {"lr": s.learning_rate, "momentum": s.momentum, "mu": s.mu, "batch": s.batch_size,
               "epochs": s.epochs, "server-round": device.round, "seed": seed}  # fmt: skip
        sent = RecordDict({"arrays": ArrayRecord(parts), "config": ConfigRecord(how)})
        own = RecordDict({"data": ArrayRecord([data.x, data.y])})
        context = Context(1, node, {"partition-id": device.device}, own, {})
        answer = self.app(Message(sent, node, "train"), context)
        if set(context.state) != {"data"}:
            raise ValueError(
                "the app keeps something in its context, which is gone after the round"
            )
        arrays, metrics = (answer.content[name] for name in ("arrays", "metrics"))
        after = np.concatenate([array.ravel() for array in arrays.to_numpy_ndarrays()])
        return LocalResult(after, int(metrics.get("steps", 1)), float(metrics["train_loss"]))


def make(learning: LearningConfig) -> FlowerTrainer:
    """What `learning.trainer` names."""
    return FlowerTrainer(app)
