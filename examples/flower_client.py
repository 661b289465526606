"""A Flower ClientApp trains the devices; the algorithm is one of ours, or flower.py's.

aerofed run --set learning.trainer=examples.flower_client:FlowerTrainer
"""

import time

import numpy as np
import torch
from flwr.app import ArrayRecord, ConfigRecord, Context, Message, Metadata, MetricRecord, RecordDict
from flwr.clientapp import ClientApp
from torch.nn.functional import cross_entropy, linear

from aerofed import LearningConfig, LocalResult

app = ClientApp()


@app.train()
def train(message: Message, context: Context) -> Message:
    """Put yours in its place. This one trains a single dense layer by SGD."""
    sent, how = message.content["arrays"].to_numpy_ndarrays(), message.content["config"]
    layer = [torch.tensor(array, requires_grad=True) for array in sent]
    x, y = (torch.tensor(array) for array in context.state["data"].to_numpy_ndarrays())
    optimiser, losses = torch.optim.SGD(layer, how["lr"], how["momentum"]), []
    for _ in range(how["epochs"]):
        for batch in torch.randperm(len(y)).split(how["batch-size"]):
            optimiser.zero_grad()
            losses.append(cross_entropy(linear(x[batch].flatten(1), *layer), y[batch]))
            losses[-1].backward()
            optimiser.step()
    trained = ArrayRecord([part.detach().numpy() for part in layer])
    metrics = MetricRecord({"train_loss": torch.stack(losses).mean().item()})
    return Message(RecordDict({"arrays": trained, "metrics": metrics}), reply_to=message)


class FlowerTrainer:
    def __init__(self, learning: LearningConfig, app: ClientApp = app) -> None:
        self.app = app

    def train(self, device, model, data, rng):
        """A device is a node for one round: its context holds its samples and ends with it."""
        ends, s = np.cumsum([np.prod(shape, dtype=int) for shape in device.shapes]), device.settings
        arrays = map(np.reshape, np.split(model, ends[:-1]), device.shapes)
        torch.manual_seed(int(rng.integers(2**31)))
        how = {"lr": s.learning_rate, "momentum": s.momentum, "proximal-mu": s.mu,
               "epochs": s.epochs, "batch-size": s.batch_size}  # fmt: skip
        content = RecordDict({"arrays": ArrayRecord(list(arrays)), "config": ConfigRecord(how)})
        node, when = device.device + 1, (str(device.round), time.time(), 3600.0, "train")
        own = RecordDict({"data": ArrayRecord([data.x, data.y])})
        context = Context(1, node, {"partition-id": device.device}, own, {})
        message = Message(content, metadata=Metadata(1, "", 0, node, "", *when))
        answer = self.app(message, context).content
        if set(context.state) != {"data"}:
            raise ValueError("the app keeps something in its context, which ends with the round")
        after = np.concatenate([a.ravel() for a in answer["arrays"].to_numpy_ndarrays()])
        steps = s.epochs * -(-len(data.y) // s.batch_size)
        return LocalResult(after, steps, float(answer["metrics"]["train_loss"]))
