"""Modules a user might bring, for images of (16, 16, 3): some train in lockstep, some cannot."""

import torch
from torch import nn


class Grouped(nn.Module):
    """Group normalisation, a tied weight, a parameter never used."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(3, 8, 3, stride=2)
        self.norm = nn.GroupNorm(2, 8)
        self.unused = nn.Parameter(torch.ones(3))
        self.dense = nn.Linear(8, 10)
        self.again = self.dense

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        pooled = self.norm(self.conv(x)).relu().mean(dim=(2, 3))
        return self.dense(pooled) + self.again(pooled.sin())


class Dense(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Linear(768, 10)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.layer(x.flatten(1))


class Drops(Dense):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return nn.functional.dropout(super().forward(x), 0.3, self.training)


class Noisy(Dense):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x) + 0.1 * torch.randn(10, device=x.device)


class Looks(Dense):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        out = super().forward(x)
        return out / float(out.abs().max().detach())


class HostsTable(Dense):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x) + torch.ones(10)


class Mixes(Dense):
    """Samples of a batch meet, so those that fill it up would be seen."""

    def __init__(self) -> None:
        super().__init__()
        self.norm = nn.BatchNorm2d(3, track_running_stats=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(self.norm(x))
