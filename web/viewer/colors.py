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
STALE: Rgb = (112, 116, 124)  # last seen occupied, too long ago to be judged
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


def of_probability(probability: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours (n, 3) of probabilities (n,) in [0, 1].

    >>> of_probability(np.array([0.0, 1.0])).tolist()
    [[0, 34, 78], [254, 232, 56]]
    """
    level = np.rint(np.clip(probability, 0.0, 1.0) * 255.0).astype(np.intp)
    found: NDArray[np.uint8] = SCALE[level]
    return found


def gradient_css(steps: int = 16) -> str:
    """The scale as a CSS gradient from left (0) to right (1)."""
    stops = (SCALE[round(255 * i / (steps - 1))] for i in range(steps))
    return "linear-gradient(to right, " + ", ".join(f"#{bytes(stop).hex()}" for stop in stops) + ")"
