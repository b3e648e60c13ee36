"""Colours of the 3D scene: a perceptual scale for probability, marks that colour-blind people can tell apart.

The scale is cividis (Nuñez, Anderton and Renslow, PLoS ONE 2018), interpolated from ten of its points; the
marks follow the Okabe-Ito palette. The scene is always dark, so that what is likely occupied is what is bright.
"""

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

_CIVIDIS = (
    "00224e",
    "123570",
    "3b496c",
    "575d6d",
    "707173",
    "8a8678",
    "a59c74",
    "c3b369",
    "e1cc55",
    "fee838",
)

BACKGROUND: Rgb = (20, 20, 20)
FLOOR: Rgb = (52, 57, 66)
UNEXPECTED: Rgb = (255, 94, 20)  # observed occupied where the prediction says free
MISSING: Rgb = (86, 180, 233)  # observed free where the prediction says occupied
STALE: Rgb = (128, 112, 20)  # last seen occupied, too long ago to be judged
STRUCTURE: tuple[Rgb, Rgb] = ((44, 48, 56), (134, 142, 154))  # what is always occupied, lowest to highest
SELECTED: Rgb = (255, 70, 220)


def rgb(hexadecimal: str) -> Rgb:
    """The bytes of six hexadecimal digits.

    >>> rgb("fee838")
    (254, 232, 56)
    """
    red, green, blue = bytes.fromhex(hexadecimal)
    return red, green, blue


def css(colour: Rgb) -> str:
    """A colour as CSS writes it.

    >>> css((0, 34, 78))
    '#00224e'
    """
    return "#" + bytes(colour).hex()


def _scale() -> NDArray[np.uint8]:
    points = np.array([rgb(text) for text in _CIVIDIS], dtype=np.float64)
    at = np.linspace(0.0, len(points) - 1.0, 256)
    channels = [np.interp(at, np.arange(len(points)), points[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


SCALE: NDArray[np.uint8] = _scale()
"""(256, 3): the colour of probability i / 255."""

OCCUPIED: Rgb = (int(SCALE[255, 0]), int(SCALE[255, 1]), int(SCALE[255, 2]))
"""Observed occupied, as expected: the colour of certainty."""


def _greys() -> NDArray[np.uint8]:
    low, high = np.array(STRUCTURE, dtype=np.float64)
    return np.rint(np.linspace(low, high, 256)).astype(np.uint8)


_GREY = 256
_MARKS = 512
CODE_OCCUPIED, CODE_UNEXPECTED, CODE_MISSING, CODE_STALE = (np.uint16(_MARKS + i) for i in range(4))
PALETTE: NDArray[np.uint8] = np.concatenate(
    [SCALE, _greys(), np.array([OCCUPIED, UNEXPECTED, MISSING, STALE], dtype=np.uint8)]
)
"""(516, 3): every colour a cell can have, by its code: the scale, the greys by height, the marks."""


def code_of_probability(probability: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Codes (n,) of probabilities (n,) in [0, 1]."""
    return np.asarray(np.clip(probability, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint16)


def code_of_height(height: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Codes (n,) of the greys of what is always occupied, at heights (n,) from 0 (lowest) to 1."""
    return np.asarray(_GREY + height * 255.0 + 0.5).astype(np.uint16)


def of_probability(probability: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (n, 3) of probabilities (n,) in [0, 1].

    >>> of_probability(np.array([0.0, 1.0])).tolist()
    [[0, 34, 78], [254, 232, 56]]
    """
    found: NDArray[np.uint8] = PALETTE[code_of_probability(probability)]
    return found


def gradient_css(steps: int = 16) -> str:
    """The scale as a CSS gradient from left (0) to right (1)."""
    return _css_gradient([css(of) for of in SCALE[np.linspace(0, 255, steps).round().astype(int)].tolist()])


def structure_css() -> str:
    """The greys of what is always occupied as a CSS gradient."""
    return _css_gradient([css(of) for of in STRUCTURE])


def _css_gradient(stops: list[str]) -> str:
    return f"linear-gradient(to right, {', '.join(stops)})"
