"""How much memory a process has taken."""

from pathlib import Path


def peak_memory_mb(pid: int) -> float:
    """The most physical memory a process ever held, in megabytes (VmHWM)."""
    return _status(pid, "VmHWM")


def memory_mb(pid: int) -> float:
    """The physical memory it holds now (VmRSS)."""
    return _status(pid, "VmRSS")


def _status(pid: int, name: str) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) / 1000
    raise ValueError(f"/proc/{pid}/status has no {name}")
