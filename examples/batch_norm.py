"""A model with buffers: a small convolutional network with batch normalisation.

The running means and variances are averaged over the arrivals like parameters, or stay with each
device, which then is measured with its own (FedBN: Li et al., ICLR 2021, arXiv 2102.07623, keeps
its scales and shifts local, too):

    aerofed run --set communities.0.network=examples.batch_norm:Net communities.0.buffers=local
"""

import torch
from torch import nn


class Net(nn.Module):
    """For images of one channel and ten classes, such as the digits."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(1, 8, 3, padding=1),
            nn.BatchNorm2d(8),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Flatten(),
            nn.LazyLinear(10),
        )
        self.layers(torch.zeros(2, 1, 8, 8))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """Logits (batch, 10) of images (batch, 1, 8, 8)."""
        return self.layers(images)
