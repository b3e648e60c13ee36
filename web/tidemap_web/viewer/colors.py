"""Colours of the 3D scene: a perceptual scale for probability, walls and marks that everybody can tell apart from it.

The scale runs from blue to yellow, the marks are orange, sky and brown. They were found by a search for the least
CIEDE2000 between any two entries of the legend, under normal vision and three dichromacies: 17 (tests/unit/web).
The scene is always dark, so that what is likely occupied is what is bright.
"""

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

_SCALE = ("151c8c", "495f96", "788599", "c5b27e", "fff937")

BACKGROUND: Rgb = (20, 20, 20)
FLOOR: Rgb = (52, 57, 66)
UNEXPECTED: Rgb = (221, 80, 16)  # observed occupied where the prediction says free
MISSING: Rgb = (87, 200, 255)  # observed free where the prediction says occupied
STALE: Rgb = (93, 58, 6)  # last seen occupied, too long ago to be judged
STRUCTURE: tuple[Rgb, Rgb] = ((76, 73, 78), (97, 96, 95))  # what is always occupied, lowest to highest
SELECTED: Rgb = (162, 96, 255)
UNKNOWN: Rgb = STRUCTURE[1]  # a door or a room without a model, or never seen
CROP: Rgb = (120, 126, 136)
TRACK: Rgb = (235, 255, 250)  # where a sensor has been


def rgb(hexadecimal: str) -> Rgb:
    """The bytes of six hexadecimal digits.

    >>> rgb("fff937")
    (255, 249, 55)
    """
    red, green, blue = bytes.fromhex(hexadecimal)
    return red, green, blue


def css(colour: Rgb) -> str:
    """A colour as CSS writes it.

    >>> css((21, 28, 140))
    '#151c8c'
    """
    return "#" + bytes(colour).hex()


def _scale() -> NDArray[np.uint8]:
    points = np.array([rgb(text) for text in _SCALE], dtype=np.float64)
    at = np.linspace(0.0, len(points) - 1.0, 256)
    channels = [np.interp(at, np.arange(len(points)), points[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


SCALE: NDArray[np.uint8] = _scale()
"""(256, 3): the colour of probability i / 255."""

OCCUPIED: Rgb = (int(SCALE[255, 0]), int(SCALE[255, 1]), int(SCALE[255, 2]))
"""Observed occupied, as expected: the colour of certainty."""


UNCERTAIN: Rgb = (int(SCALE[128, 0]), int(SCALE[128, 1]), int(SCALE[128, 2]))
FREE: Rgb = (int(SCALE[26, 0]), int(SCALE[26, 1]), int(SCALE[26, 2]))
"""Verdicts, as the scale has 0.5 and 0.1."""


def _greys() -> NDArray[np.uint8]:
    low, high = np.array(STRUCTURE, dtype=np.float64)
    return np.rint(np.linspace(low, high, 256)).astype(np.uint8)


def _differences() -> NDArray[np.uint8]:
    """From `MISSING` over a dark grey to `UNEXPECTED`."""
    points = np.array([MISSING, STRUCTURE[0], UNEXPECTED], dtype=np.float64)
    at = np.linspace(0.0, 2.0, 256)
    return np.rint([np.interp(at, np.arange(3), channel) for channel in points.T]).T.astype(np.uint8)


_GREY = 256
_MARKS = 512
CODE_OCCUPIED, CODE_UNEXPECTED, CODE_MISSING, CODE_STALE = (np.uint16(_MARKS + i) for i in range(4))
_DIFFERENCES = 516
PALETTE: NDArray[np.uint8] = np.concatenate(
    [SCALE, _greys(), np.array([OCCUPIED, UNEXPECTED, MISSING, STALE], dtype=np.uint8), _differences()]
)
"""(772, 3): every colour a cell can have, by its code: the scale, greys by height, marks, differences from -1 to 1."""


def code_of_probability(probability: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Codes (n,) of probabilities (n,) in [0, 1]."""
    return np.asarray(np.clip(probability, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint16)


def code_of_height(height: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Codes (n,) of the greys of what is always occupied, at heights (n,) from 0 (lowest) to 1."""
    return np.asarray(_GREY + height * 255.0 + 0.5).astype(np.uint16)


def code_of_difference(difference: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Codes (n,) of what was seen less what was expected, in [-1, 1]."""
    return np.asarray(_DIFFERENCES + (difference + 1.0) * 127.5 + 0.5).astype(np.uint16)


def of_probability(probability: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (n, 3) of probabilities (n,) in [0, 1].

    >>> of_probability(np.array([0.0, 1.0])).tolist()
    [[21, 28, 140], [255, 249, 55]]
    """
    found: NDArray[np.uint8] = PALETTE[code_of_probability(probability)]
    return found


def css_of_probability(probability: float) -> str:
    """One colour of the scale."""
    red, green, blue = of_probability(np.array([probability]))[0].tolist()
    return css((red, green, blue))


def gradient_css(low: float = 0.0, steps: int = 16) -> str:
    """The scale as a CSS gradient from left (`low`) to right (1)."""
    return _css_gradient([css_of_probability(each) for each in np.linspace(low, 1.0, steps).tolist()])


def differences_css() -> str:
    """The differences from -1 (left) to 1 as a CSS gradient."""
    return _css_gradient([css(each) for each in (MISSING, STRUCTURE[0], UNEXPECTED)])


def structure_css() -> str:
    """The greys of what is always occupied as a CSS gradient."""
    return _css_gradient([css(of) for of in STRUCTURE])


def _css_gradient(stops: list[str]) -> str:
    return f"linear-gradient(to right, {', '.join(stops)})"
