"""The channel presets with their numbers, and how far each reaches."""

from dataclasses import fields
from pathlib import Path

from fl.radio.channel import (
    CHANNEL_PRESETS,
    DEFAULT_PRESET,
    Channel,
    average_per,
    served_radius_m,
)

HEAD = """# Channels

Generated from the code (`python docs/generate.py`). A *channel* is a model of the radio between a
device and the drone. It says how likely a packet is lost at a given distance: the *packet error
rate* (PER).

Choose one of the presets below, and change single numbers of it if you like. All keys are under
[`channel`](configuration.md#channel), except the height of the flight, `mission.altitude_m`:

    aerofed run --set channel.preset=urban
    aerofed link-budget --set channel.preset=urban --set channel.extra_gain_db=3

`aerofed link-budget` prints the packet error rate of a channel over distance.

## The presets

| column | what |
|---|---|
| radius | horizontal distance up to which at least half of the packets arrive |
| overhead | packet error rate straight above a device: the best that any flight can reach |

Both are for a flight at 60 m; with another `mission.altitude_m` they change. For comparison: the
area of the quick start is 800 m wide.

"""

ABOUT = {
    "suburban": "17 dB more power than the paper prints, see below",
    "suburban+10dB": "10 dB more than printed: the drone must fly close to a device",
    "suburban+15dB": "15 dB more than printed",
    "suburban+20dB": "20 dB more than printed",
    "suburban+30dB": "30 dB more: the paper's power read in dBW, its noise in dBm",
    "literal": "the paper's link budget as printed: nobody is reached",
    "literal-log-variance": "as printed, but sigma read as the variance of a natural logarithm",
    "suburban-log-variance": "the same reading, with 17 dB more power",
    "urban": "line of sight as in a city (Al-Hourani et al. 2014)",
    "dense-urban": "line of sight as in a dense city",
    "high-rise": "line of sight as between high-rise buildings",
}

SYMBOLS = {
    "altitude_m": "height of the flight, H (m)",
    "alpha_los": "path-loss exponent in line of sight",
    "alpha_nlos": "path-loss exponent without line of sight",
    "beta_los_db": "gain at 1 m in line of sight (dB)",
    "beta_nlos_db": "gain at 1 m without line of sight (dB)",
    "sigma_los": "shadowing in line of sight: standard deviation of its natural logarithm",
    "sigma_nlos": "the same without line of sight",
    "a1_per_rad": "slope of the line-of-sight probability over the elevation (1/rad)",
    "a2": "offset of the line-of-sight probability",
    "tx_power_db": "transmit power, P (dB)",
    "noise_db": "noise power, N0 (dB)",
    "snr_threshold": "signal-to-noise ratio below which a packet is lost (linear)",
}

TAIL = """
## Why the default has 17 dB more

With the paper's link budget as printed (`literal`), practically every packet is lost, even straight
above a device. So at least one of its numbers is not what its authors used. `suburban` adds 17 dB.
With those, a hover above the middle of the area loses most packets, and a tour of 800 m delivers
most: where the drone flies makes a difference.

## The model

How the packet error rate of a device at horizontal distance r follows:

1. The device sees the drone at the elevation theta = arctan(H / r).
2. It is in line of sight with probability rho = 1 / (1 + exp(-a1 theta + a2)).
3. The received power is P beta / d^alpha times a log-normal shadowing, where d is the distance from
   device to drone. Gain, exponent and shadowing have other values in line of sight than without.
4. The packet is lost if the signal-to-noise ratio is below the threshold.

[Learning](learning.md#radio) says how the fate of a packet is drawn.

## What is assumed

Of the whole model; *ours* is what neither the paper nor a standard says.

%ASSUMED%

## The logistic stand-in

The paper's planner uses a curve in place of this packet error rate that is easier to optimise:
1 / (1 + exp(b1 theta + b2)). `aerofed link-budget` fits b1 and b2 to the channel, by least squares
over the distances of 800 x 800 m, and says how far the curve is off at worst. Only `paper` and
`paper_literal` plan with it: see [the planner](planner.md). Which updates arrive never depends on
it.
"""


def page() -> str:
    presets = CHANNEL_PRESETS.items()
    differing = [f.name for f in fields(Channel) if len({_of(c, f.name) for _, c in presets}) > 1]
    lines = ["| preset | radius | overhead | what |", "|---|---:|---:|---|"]
    for name, channel in presets:
        mark = " (default)" if name == DEFAULT_PRESET else ""
        radius = served_radius_m(channel)
        reach = f"{radius:.0f} m" if radius > 0.0 else "none"
        per = float(average_per(channel, 0.0))
        overhead = f"{per:.4f}" if per >= 0.0001 else "under 0.0001"
        lines.append(f"| `{name}`{mark} | {reach} | {overhead} | {ABOUT[name]} |")
    lines += ["", "## The numbers", "", "The same for all presets:", "", "| key | value | what |"]
    lines.append("|---|---:|---|")
    some = CHANNEL_PRESETS[DEFAULT_PRESET]
    for field in fields(Channel):
        if field.name not in differing:
            value = _of(some, field.name)
            lines.append(f"| `{field.name}` | {value} | {SYMBOLS[field.name]} |")
    lines += ["", "Different from preset to preset:", ""]
    lines.append("| preset | " + " | ".join(f"`{name}`" for name in differing) + " |")
    lines.append("|---|" + "---:|" * len(differing))
    for name, channel in presets:
        lines.append(f"| `{name}` | " + " | ".join(_of(channel, n) for n in differing) + " |")
    lines += ["", *(f"- `{name}`: {SYMBOLS[name]}" for name in differing)]
    return HEAD + "\n".join(lines) + "\n" + TAIL.replace("%ASSUMED%", _assumed())


def _assumed() -> str:
    """The table of assumptions; a row a line: what, where from, what else would be."""
    rows = Path(__file__).with_name("assumed.txt").read_text(encoding="utf-8").splitlines()
    heads = ["assumed|from|if it were not so", "---|---|---"]
    return "\n".join(f"| {row.replace('|', ' | ')} |" for row in heads + rows)


def _of(channel: Channel, name: str) -> str:
    return f"{getattr(channel, name):.4g}"
