"""Communities and their devices: data loaded, spread over devices, networks made. Set up once."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from fl.arrays import Floats, Ints, frozen
from fl.config import CommunityConfig, LearningConfig
from fl.data import partition
from fl.data.dataset import Dataset, Split, held_out_of_each, hold_out, subset
from fl.data.load import load
from fl.federation.algorithms import Algorithm, make_algorithm
from fl.federation.device_work import compute_times
from fl.training.local import CustomTrainer, Network, Scaling, make_trainer, scaling_of
from fl.training.networks import make_network
from native.errors import SettingError

Stream = Callable[[str], np.random.Generator]

TEST_SEED = 2206_02043  # of the draw that holds out the test part, the same in every run


@dataclass(frozen=True, eq=False)
class Community:
    """A group of devices with one task and one model; devices count from 0 within it."""

    config: CommunityConfig
    dataset: Dataset
    network: Network
    shares: tuple[Ints, ...]  # training samples of each device
    counts: Ints  # (K_c, classes) training samples of each device and class
    test_share: float | None  # of the held-out images; None: reported on those that validate

    @property
    def name(self) -> str:
        """The community's name in the settings."""
        return self.config.name

    @property
    def own_buffers(self) -> bool:
        """Whether each device keeps the network's buffers to itself."""
        return self.config.buffers == "local"

    @property
    def upload_bits(self) -> int:
        """Size of an update in bits: as configured, else 32 for each number of the network."""
        if self.config.upload_bits is not None:
            return self.config.upload_bits
        return 32 * sum(map(math.prod, self.network.shapes))

    @cached_property
    def scaling(self) -> Scaling:
        """Normalisation of pixels over the training images, computed on first use."""
        return scaling_of(self.dataset.train)

    @cached_property
    def p(self) -> Floats:
        """Data share p_k = |D_k| / sum of |D_i| of each device in the community, (K_c,)."""
        samples = self.counts.sum(axis=1).astype(np.float64)
        return np.asarray(samples / samples.sum(), dtype=np.float64)

    @cached_property
    def _held_out(self) -> tuple[Split, Split]:
        """Validation and reporting images, the same where no test part is held out."""
        every = self.dataset.validation
        if self.test_share is None:
            return every, every
        return hold_out(every.images, every.labels, share=self.test_share, seed=TEST_SEED)

    @property
    def validation(self) -> Split:
        """The images on which devices measure the accuracy that they send."""
        return self._held_out[0]

    @property
    def reporting(self) -> Split:
        """The images on which accuracy is reported."""
        return self._held_out[1]

    @cached_property
    def validation_counts(self) -> Ints:
        """Validation images of each class, (classes,)."""
        return np.bincount(self.validation.labels, minlength=self.dataset.classes)


@dataclass(frozen=True, eq=False)
class Federation:
    """All communities and their algorithm; devices are numbered through them, from 0 to K - 1."""

    communities: tuple[Community, ...]
    learning: LearningConfig
    algorithm: Algorithm
    stream: Stream
    trainer: CustomTrainer | None = None  # None: each network trains itself

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the communities."""
        return tuple(community.name for community in self.communities)

    @cached_property
    def community_of(self) -> Ints:
        """Index of each device's community, (K,)."""
        sizes = [len(community.shares) for community in self.communities]
        return np.repeat(np.arange(len(sizes)), sizes).astype(np.int64)

    @cached_property
    def p(self) -> Floats:
        """Data share p_k of each device within its community, (K,)."""
        return np.concatenate([community.p for community in self.communities])

    @cached_property
    def compute_s(self) -> Floats:
        """Training time of each device for one update in seconds, (K,)."""
        return np.concatenate(
            [
                compute_times(
                    community.config,
                    community.counts.sum(axis=1),
                    epochs=self.learning.local_epochs,
                    rng=self.stream(f"fl/{community.name}/compute"),
                )
                for community in self.communities
            ]
        )

    @cached_property
    def upload_bits(self) -> Floats:
        """Size of each device's update in bits, (K,)."""
        sizes = [np.full(len(c.shares), c.upload_bits) for c in self.communities]
        return np.concatenate(sizes).astype(np.float64)

    def members(self, index: int) -> slice:
        """Return the slice of community `index` in arrays over all K devices."""
        first = int(np.searchsorted(self.community_of, index))
        return slice(first, first + len(self.communities[index].shares))

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of data, assignment, networks and algorithm, which a checkpoint must match."""
        digest = hashlib.sha256(repr(self.algorithm).encode())
        if self.trainer is not None:
            digest.update(repr(self.trainer).encode())
        for community in self.communities:
            digest.update(repr((community.name, community.config.task)).encode())
            digest.update(repr(community.network.shapes).encode())
            digest.update(repr(community.dataset.provenance.files).encode())
            digest.update(community.dataset.labels.tobytes())
            for share in community.shares:
                digest.update(share.tobytes() + b"|")
        return digest.hexdigest()


def build_federation(
    communities: Sequence[CommunityConfig],
    learning: LearningConfig,
    *,
    data_dir: Path | None,
    stream: Stream,
) -> Federation:
    """Load the data, spread them over the devices, make the networks.

    `stream(name)` gives a fresh generator at the start of the stream of that name. Raises
    `InputError` for settings and files that cannot be used.
    """
    names = [config.name for config in communities]
    for name in names:
        if names.count(name) > 1:
            raise SettingError("communities.name", name, "is given twice")
    test_share = learning.test_share if learning.report_on == "test" else None
    built = [
        _community(index, config, data_dir=data_dir, stream=stream, test_share=test_share)
        for index, config in enumerate(communities)
    ]
    algorithm, trainer = make_algorithm(learning), make_trainer(learning)
    return Federation(tuple(built), learning, algorithm, stream, trainer)


def _community(
    index: int,
    config: CommunityConfig,
    *,
    data_dir: Path | None,
    stream: Stream,
    test_share: float | None,
) -> Community:
    dataset = load(config.task, data_dir=data_dir, data_file=config.data_file, community=index)
    dataset = subset(dataset, config.subset)
    try:
        shares = _shares(index, config, dataset, stream(f"fl/{config.name}/partition"))
        network = make_network(
            config.network,
            image_shape=dataset.image_shape,
            classes=dataset.classes,
            convnet=config.convnet,
            community=index,
        )
        if config.buffers is not None and network.buffers == 0:
            raise SettingError("buffers", config.buffers, "its network has none: leave it out")
    except SettingError as error:
        key = f"communities.{index}.{error.key}"
        raise SettingError(key, error.value, error.allowed) from error
    counts = frozen(partition.class_counts(dataset.labels, shares, classes=dataset.classes))
    held_out = dataset.held_out
    if test_share is not None and held_out.sum() == held_out_of_each(held_out, test_share).sum():
        raise SettingError(
            "learning.report_on",
            "test",
            f"must be 'validation' for community {config.name}: of the {held_out.sum()} "
            f"images of {config.task} that do not train, none would be left to validate",
        )
    return Community(config, dataset, network, tuple(shares), counts, test_share)


def _shares(
    index: int, config: CommunityConfig, dataset: Dataset, rng: np.random.Generator
) -> list[Ints]:
    """Indices of the training samples of each device of a community."""
    labels, classes, devices = dataset.labels, dataset.classes, config.devices
    weights = None if config.data_shares is None else np.array(config.data_shares)
    match config.partition:
        case "labels":
            owns = partition.draw_owners(
                devices,
                classes,
                per_device=config.labels_per_device,
                coverage=config.coverage,
                rng=rng,
            )
            return partition.by_labels(labels, owns, rng=rng, weights=weights)
        case "dirichlet":
            return partition.by_dirichlet(
                labels,
                devices=devices,
                classes=classes,
                alpha=config.dirichlet_alpha,
                rng=rng,
                weights=weights,
            )
        case "iid":
            return partition.iid(len(labels), devices=devices, rng=rng, weights=weights)
        case "owners":
            if dataset.owners is None:
                raise SettingError(
                    "partition", "owners", f"the data of {config.task} do not tell any owners"
                )
            return partition.by_owner(dataset.owners, devices=devices, rng=rng)
        case name:
            task = partition.PartitionTask(labels, dataset.owners, devices, classes, rng)
            return partition.CustomPartition.found(name, index).shares(task)
