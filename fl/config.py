"""Settings of the radio, the communities and the learning, as the user writes them."""

from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

from fl.plugin_code import checked_name
from fl.radio.channel import CHANNEL_PRESETS, DEFAULT_PRESET, Channel, constants_model
from fl.radio.uplink import Gate
from native.errors import did_you_mean

RADIOS = ("channel", "buildings", "map")
BELIEFS = (*RADIOS, "learned", "truth")
BUILT_IN_NETWORKS = ("lenet", "mcmahan", "convnet")
ALGORITHMS = ("fedprox", "fedavg", "fedavgm", "fedadam", "scaffold")
WEIGHED_PARTITIONS = ("labels", "dirichlet", "iid")
PARTITIONS = (*WEIGHED_PARTITIONS, "owners")

USUAL_DEVICES = 6  # of a community that says nothing of them

Positive = Annotated[float, Field(gt=0.0)]
Seconds = Annotated[float, Field(ge=0.0, le=1e6)]
Coordinate = Annotated[float, Field(ge=-100_000.0, le=100_000.0)]
Unheard = Literal["left-out", "zero"]
Late = Literal["missed", "stale"]
Missed = Literal["lost-too", "unscheduled"]
TASKS = ("digits", "colour-shapes", "mnist", "fashion-mnist", "cifar10", "npz")


def one_of(names: tuple[str, ...]) -> AfterValidator:
    """Validator of a name: one of the built-in names, or a plug-in's."""
    return AfterValidator(lambda name: checked_name(name, names))


PluginName = Annotated[str, one_of(())]


class _Frozen(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


class _NamedChannel(_Frozen):
    """Preset of the channel, and how packets are drawn and sent on it."""

    preset: str = DEFAULT_PRESET
    """name of a channel; docs/channels.md lists them"""
    extra_gain_db: float = Field(0.0, ge=-100.0, le=100.0)
    """added to the preset's transmit power"""
    gate: Gate = "average"
    """lose packets with the 'average' PER of radio.truth, or draw segment and shadowing of each on
    the channel ('instantaneous')"""
    correlation_m: Positive | None = Field(None, le=1e5)
    """metres over which line of sight and shadowing change: they are drawn once for each device and
    are the same at the same place in all rounds; by default they are drawn for each packet, as in
    the paper"""
    upload_rate_bps: Positive | None = Field(None, le=1e12)
    """bits a second of one device at a time: the aircraft hovers at a waypoint until those whom it
    serves there have sent, one after another; without it an upload takes no time"""

    @field_validator("preset")
    @classmethod
    def _known(cls, preset: str) -> str:
        if preset not in CHANNEL_PRESETS:
            raise ValueError(
                f"no such channel; there are {', '.join(CHANNEL_PRESETS)}"
                f"{did_you_mean(preset, CHANNEL_PRESETS)}"
            )
        return preset


_NOT_OF_THE_CHANNEL = set(_NamedChannel.model_fields)

if TYPE_CHECKING:  # that may not know what is made while the program runs
    _Constants = _NamedChannel
else:
    _Constants = constants_model("_Constants", _NamedChannel, optional=True)


class ChannelConfig(_Constants):
    """A channel preset, and changes to its constants."""

    def channel(self, *, altitude_m: float | None = None) -> Channel:
        """The channel these settings describe, at `altitude_m` (the preset's 60 m by default)."""
        base = CHANNEL_PRESETS[self.preset]
        changes = self.model_dump(exclude=_NOT_OF_THE_CHANNEL, exclude_none=True)
        if altitude_m is not None:
            changes["altitude_m"] = altitude_m
        changed = replace(base, **changes)
        return replace(changed, tx_power_db=changed.tx_power_db + self.extra_gain_db)


class RadioConfig(_Frozen):
    """The radio that decides whether a packet arrives, and what plans believe about it."""

    truth: Annotated[str, one_of(RADIOS)] = "channel"
    """the 'channel', which is an average over places; 'buildings' that stand in the way, those of
    the area; a 'map' of gains; or a radio of your own that gives the PER, as
    'package.module:factory'"""
    belief: Annotated[str, one_of(BELIEFS)] = "channel"
    """what plans are made with: the 'channel'; the 'buildings', of whose shadowing it knows the
    deviation only; the 'map'; what is 'learned' from pilot tones on the way, from the prior on, or
    as 'package.module:factory' says; or the 'truth'"""
    prior: Literal["channel", "buildings", "map"] | None = None
    """belief learned, or your own: what is believed before anything is heard; the 'channel' (the
    default), the 'buildings' or the 'map'"""
    pilots: Literal["all", "scheduled"] | None = None
    """belief learned, or your own: the tones of 'all' devices are heard (the default), or of those
    that are 'scheduled' in the round"""
    pilot_s: float | None = Field(None, gt=0.0, lt=1.0)
    """belief learned, or your own: air time of one tone. In each second tones come first, one after
    another, and uploads have what is left, so they take longer; without it tones take no time"""
    map_file: Path | None = None
    """truth or belief is a map: the file, as `aerofed radio-map` writes it"""
    scene: str | None = Field(None, min_length=1)
    """map: of this scene of Sionna RT, an extra, such as 'munich', in cells of 10 m about its
    middle; it is traced where map_file is not given, and kept in ~/.cache/aerofed"""
    map_sha256: str | None = Field(None, pattern="^[0-9a-f]{64}$")
    """map: of the file's bytes, which a run notes: it is repeated with no other"""
    environment: Literal["UMi", "UMa"] = "UMi"
    """buildings: path loss, shadowing and its correlation of 3GPP's street canyons (UMi) or of its
    larger cells (UMa)"""
    carrier_hz: float = Field(2.4e9, ge=5e8, le=1e11)
    """buildings: carrier frequency"""
    device_height_m: float = Field(1.5, ge=0.1, le=100.0)
    """buildings: of the devices' antennas above the ground"""
    shadowing: bool = True
    """buildings: add shadowing, a normal field over the places of the aircraft that is the same in
    every round, and let walls around devices differ"""
    indoors: Literal["entry-loss", "refused"] = "entry-loss"
    """buildings: a device within one pays the way through a wall, or is refused"""
    walls: Literal["low-loss", "high-loss"] = "low-loss"
    """buildings: 3GPP's walls around devices: 30 % plain glass and 70 % concrete, or 70 % coated
    glass and 30 % concrete"""
    tx_power_dbm: float = Field(0.0, ge=-100.0, le=60.0)
    """power that devices send"""
    bandwidth_hz: float = Field(1e6, ge=1.0, le=1e10)
    """width of the band"""
    noise_figure_db: float = Field(7.0, ge=0.0, le=50.0)
    """of the aircraft's receiver"""
    snr_threshold_db: float = Field(10.0, ge=-50.0, le=60.0)
    """SNR under which a packet is lost"""
    fading_db: float = Field(3.0, gt=0.0, le=30.0)
    """standard deviation of the SNR about that of the place, from packet to packet"""

    @property
    def listens(self) -> bool:
        """Whether the radio belief hears pilot tones in flight: the learned one, or a plug-in."""
        return self.belief == "learned" or self.belief not in BELIEFS


class ConvNetConfig(_Frozen):
    """For network = 'convnet': blocks (convolution, 2x2 max-pooling, ReLU), then dense layers."""

    channels: tuple[Annotated[int, Field(ge=1, le=512)], ...] = Field(
        (16, 32), min_length=0, max_length=8
    )
    """feature maps after each block; its convolution keeps height and width, its pooling halves
    them"""
    kernel: Literal[3, 5] = 3
    """width of the convolutions"""
    hidden: tuple[Annotated[int, Field(ge=1, le=4096)], ...] = Field(
        (64,), min_length=0, max_length=7
    )
    """units of the dense layers between the blocks and the classes"""


class CommunityConfig(_Frozen):
    """Devices with one common task, and how its data are spread over them."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]{0,39}$", examples=["mnist"])
    """unique among the communities"""
    task: Annotated[str, one_of(TASKS)] = Field(examples=["digits"])
    """data set: 'digits' and 'colour-shapes', which need no files, 'mnist', 'fashion-mnist',
    'cifar10', 'npz', or one of your own as 'package.module:factory'"""
    data_file: str | None = None
    """for task = 'npz': the file's name in the data folder, or its absolute path"""
    subset: float = Field(1.0, gt=0.0, le=1.0)
    """share of the data set that is used, the first images of each class and as many of each: runs
    on a tenth take a tenth of the time"""
    positions_m: tuple[tuple[Coordinate, Coordinate], ...] | None = Field(
        None, min_length=1, max_length=1000
    )
    """x, y of each device in area coordinates; without it and positions_file they are drawn from
    the seed"""
    positions_file: str | None = None
    """where the devices stand: a CSV file with columns x, y or lat, lon, a run's devices.csv, or
    GeoJSON points; columns or properties community (of a file for several) and share count too.
    Beside the configuration, or an absolute path"""
    data_shares: tuple[Annotated[float, Field(gt=0.0, le=1e6)], ...] | None = Field(
        None, min_length=1, max_length=1000
    )
    """a weight for each device when samples are split: of all data with partition = 'iid', of each
    class among its owners with 'labels', of what is drawn with 'dirichlet'; without it all weigh
    alike"""
    devices: int = Field(
        default_factory=lambda known: len(known.get("positions_m") or ()) or USUAL_DEVICES,
        ge=1,
        le=1000,
    )
    """number of devices; as many as there are positions, where these are given"""
    compute_s: Seconds | tuple[Seconds, Seconds] | None = None
    """how long a device trains for its update; [from, to]: drawn for each device once, uniformly;
    without it training takes no time"""
    compute_times_s: tuple[Seconds, ...] | None = Field(None, min_length=1, max_length=1000)
    """the same, device by device"""
    compute_s_per_sample: Seconds | None = None
    """added to it for each of a device's own samples, in each local epoch: who has more data takes
    longer"""
    upload_bits: int | None = Field(None, ge=1, le=10**13)
    """size of an update; by default 32 for each number of the network"""
    partition: Annotated[str, one_of(PARTITIONS)] = "labels"
    """how samples are spread over the devices: by 'labels', 'dirichlet', 'iid', by the 'owners'
    that the data set tells, or as your own 'package.module:function' says"""
    labels_per_device: int = Field(2, ge=1, le=1000)
    """for partition = 'labels': classes each device owns"""
    coverage: bool = False
    """for partition = 'labels': every class gets an owner"""
    dirichlet_alpha: Positive = Field(0.5, le=1e6)
    """for partition = 'dirichlet': small is uneven"""
    network: Annotated[str, one_of(BUILT_IN_NETWORKS)] = "lenet"
    """'lenet', 'mcmahan', 'convnet', or a torch module as 'package.module:callable', which needs
    the extra `torch`"""
    buffers: Literal["averaged", "local"] | None = None
    """for a torch module with buffers, such as the running statistics of batch normalisation:
    'averaged' over the arrivals (the default), or 'local': each device keeps its own, and is
    measured with them"""
    convnet: ConvNetConfig | None = None
    """for network = 'convnet': how many layers, how large; what is left out has its default"""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuse keys that do not go together."""
        if self.buffers is not None and self.network in BUILT_IN_NETWORKS:
            raise ValueError("buffers belongs to a torch module of your own: no other has any")
        if self.positions_m is not None and self.positions_file is not None:
            raise ValueError("positions_m and positions_file: one of them, not both")
        for name in ("positions_m", "data_shares", "compute_times_s"):
            values = getattr(self, name)
            # Of a file it is not known yet how many it holds.
            known = self.positions_file is None or name == "positions_m"
            if values is not None and known and len(values) != self.devices:
                raise ValueError(
                    f"{name} has {len(values)} entries for {self.devices} devices; there must be "
                    "one for each"
                )
        if self.data_shares is not None and self.partition not in WEIGHED_PARTITIONS:
            raise ValueError(
                f"data_shares weighs nothing with partition = {self.partition!r}, which says "
                f"itself who has how much: leave it out, or have {', '.join(WEIGHED_PARTITIONS)}"
            )
        if isinstance(self.compute_s, tuple) and self.compute_s[0] > self.compute_s[1]:
            low, high = self.compute_s
            raise ValueError(
                f"compute_s = [{low:g}, {high:g}] is [from, to]: from must not be above to"
            )
        if self.compute_s is not None and self.compute_times_s is not None:
            raise ValueError("compute_s and compute_times_s: one of them, not both")
        if self.convnet is not None and self.network != "convnet":
            raise ValueError(
                f"the table convnet is for network = 'convnet' only; network = "
                f"'{self.network}' has sizes of its own: leave it out"
            )
        if self.task == "npz" and self.data_file is None:
            raise ValueError("task = 'npz' needs data_file, the name of its .npz file")
        if self.task != "npz" and self.data_file is not None:
            raise ValueError(
                f"data_file is for task = 'npz' only; task = '{self.task}' has files of its "
                "own: leave data_file out"
            )
        if self.data_file is not None and ".." in PurePath(self.data_file).parts:
            raise ValueError(
                "data_file stays in the data folder; a file elsewhere is given by its absolute path"
            )
        return self


class LearningConfig(_Frozen):
    """Local training, aggregation, fairness. The defaults are the paper's."""

    algorithm: Annotated[str, one_of(ALGORITHMS)] = "fedprox"
    """how devices train and the UAV aggregates: fedprox, fedavg, fedavgm, fedadam, scaffold, or one
    of your own as 'package.module:factory'"""
    mu: float = Field(0.1, ge=0.0, le=100.0)
    """proximal weight; fedprox only, the others have none"""
    learning_rate: Positive = Field(0.01, le=10.0)
    """of the local SGD"""
    momentum: float = Field(0.9, ge=0.0, lt=1.0)
    """of the local SGD; scaffold trains with plain SGD"""
    batch_size: int = Field(16, ge=1, le=65536)
    """samples of one local step"""
    local_epochs: int = Field(1, ge=1, le=1000)
    """passes over a device's data a round"""
    server_learning_rate: Positive | None = Field(None, le=100.0)
    """default 1 for fedavgm and scaffold, 0.01 for fedadam"""
    server_momentum: float = Field(0.9, ge=0.0, lt=1.0)
    """beta of fedavgm, beta_1 of fedadam"""
    server_beta2: float = Field(0.99, ge=0.0, lt=1.0)
    """beta_2 of fedadam"""
    server_tau: Positive = Field(0.001, le=1.0)
    """adaptivity tau of fedadam"""
    cov_period_rounds: int = Field(4, ge=1, le=1000)
    """l: rounds between updates of the fairness CoV"""
    importance_boost: float = Field(1.5, gt=1.0, le=100.0)
    """lambda: factor on devices that missed a round"""
    late: Late = "missed"
    """what becomes of a device that still trains when the aircraft comes for its update: nothing
    arrives, and it begins anew with the next round ('missed'), or it goes on, and sends in a later
    round what it made of the older model ('stale')"""
    missed: Missed = "lost-too"
    """who missed a round, and gets the boost: the unscheduled and those whose update was lost
    ('lost-too', the paper's text), or the 'unscheduled' (its equation)"""
    cov_unheard: Unheard = "left-out"
    """what a device that was never heard is to the CoV of its community: 'left-out' of it, or
    accuracy 'zero'"""
    cov_floor: Positive = Field(0.1, le=1.0)
    """least CoV that importance sees, so that a fair community still counts"""
    report_on: Literal["test", "validation"] = "test"
    """what reported accuracy is measured on: a 'test' part of the task's held-out images, which
    importance never sees, or the 'validation' images that drive the CoV"""
    test_share: float = Field(0.5, gt=0.0, lt=1.0)
    """part of each class held out for report_on = 'test'"""
    trainer: PluginName | None = Field(None, examples=["my_package.my_module:factory"])
    """local training of your own, as 'package.module:factory'"""

    @model_validator(mode="after")
    def _share_with_test_only(self) -> Self:
        # The default stands in every configuration that a run has written down.
        share = type(self).model_fields["test_share"].default
        if self.report_on == "validation" and self.test_share != share:
            raise ValueError(
                "test_share belongs to report_on = 'test'; on 'validation' images no test part is "
                "held out"
            )
        return self
