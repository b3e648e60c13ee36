"""Where things are, so that no test counts parent folders."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
