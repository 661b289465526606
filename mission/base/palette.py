"""Colours shared by the log's scene, the figures and the report.

Communities take the Okabe-Ito set, which stays apart for colour-blind readers (Okabe and Ito 2008,
"Color Universal Design"); packet error rates run from teal (0) over yellow to vermilion (1).
"""

RGB = tuple[float, float, float]

_OKABE_ITO = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#F0E442")
COLOURS = len(_OKABE_ITO)
PER_RAMP = ((0.0, "#0B7A75"), (0.5, "#F2C14E"), (1.0, "#C8361D"))

# By role, on white paper and on dark: a page takes what its reader's theme asks for.
_ROLES = (
    ("paper", "#FFFFFF", "#161D25"),
    ("desk", "#F3F5F7", "#0E141A"),
    ("ink", "#16202B", "#E8EDF2"),
    ("soft", "#56626F", "#9AA7B4"),
    ("grid", "#DFE4E9", "#2B3540"),
    ("planned", "#5B6770", "#93A1AE"),
    ("flown", "#111827", "#F2F5F8"),
    ("accent", "#0072B2", "#56B4E9"),
    ("band", "#BCC8D4", "#43525F"),  # of a planned path that is drawn wide, under the flown one
    ("fence", "#B3261E", "#FF8A80"),
)
LIGHT = {role: colour for role, colour, _ in _ROLES}
DARK = {role: colour for role, _, colour in _ROLES}
WALL, ROOF = "#8C97A3", "#BCC8D4"  # of buildings
PLANNED, FLOWN, FENCE = LIGHT["planned"], LIGHT["flown"], LIGHT["fence"]


def community_colour(index: int) -> str:
    """`#RRGGBB` of the community with this index; the set repeats after `COLOURS`."""
    return _OKABE_ITO[index % COLOURS]


def per_colour(per: float) -> RGB:
    """Red, green, blue in 0..1 of a packet error rate; values outside 0..1 are clipped."""
    per = min(max(per, 0.0), 1.0)
    (low, first), (high, second) = PER_RAMP[:2] if per <= 0.5 else PER_RAMP[1:]
    share = (per - low) / (high - low)
    red, green, blue = (a + share * (b - a) for a, b in zip(rgb(first), rgb(second), strict=True))
    return red, green, blue


def rgb(colour: str) -> RGB:
    """`#RRGGBB` as red, green, blue in 0..1."""
    return (
        int(colour[1:3], 16) / 255.0,
        int(colour[3:5], 16) / 255.0,
        int(colour[5:7], 16) / 255.0,
    )
