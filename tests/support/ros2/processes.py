"""The node and the robot beside it as processes of `.venv/ros`, which hear nobody but each other."""

import json
import os
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.support.paths import ROOT
from tests.support.server import clean_environment

PYTHON = ROOT / ".venv" / "ros" / "bin" / "python"
EXAMPLE = ROOT / "docs" / "examples" / "ros2"
PACKAGE = "tidemap_ros"
STOP_S = 30.0


@dataclass(frozen=True)
class Workspace:
    """A folder in which colcon has built the example."""

    folder: Path

    @property
    def installed(self) -> Path:
        """Where the package is."""
        return self.folder / "install" / PACKAGE

    @classmethod
    def built(cls, folder: Path) -> "Workspace":
        """Build the example as people do."""
        words = ["--log-base", "log", "build", "--base-paths", str(EXAMPLE), "--packages-select", PACKAGE]
        env = clean_environment() | {"PATH": f"{PYTHON.parent}:{os.environ['PATH']}"}
        colcon = [str(PYTHON), str(PYTHON.parent / "colcon"), *words]
        done = subprocess.run(colcon, cwd=folder, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return cls(folder)

    def environment(self, **more: str) -> dict[str, str]:
        """As after `source install/setup.sh`, with the stand-in for tf2_ros."""
        (packages,) = self.installed.glob("lib/python*/site-packages")
        talk = {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        path = os.pathsep.join(map(str, (packages, Path(__file__).parent)))
        logs = {"ROS_LOG_DIR": str(self.folder / "ros")}
        return clean_environment() | talk | logs | more | {"PYTHONPATH": path}


@contextmanager
def node(workspace: Workspace, log: Path, keys: dict[str, str], **parameters: object) -> Iterator[None]:
    """The node, as `ros2 launch` starts it; it must end by SIGINT as it should."""
    said = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    config = workspace.installed / "share" / PACKAGE / "config" / "tidemap.yaml"
    program = workspace.installed / "lib" / PACKAGE / "tidemap"
    command = [str(PYTHON), str(program), "--ros-args", "--params-file", str(config), *said]
    with log.open("wb") as output:
        process = subprocess.Popen(command, env=workspace.environment(**keys), stdout=output, stderr=output)
        try:
            yield
            assert process.poll() is None, log.read_text()
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_S)
            finally:
                process.kill()
    assert process.returncode == 0, log.read_text()
    assert "Traceback" not in log.read_text()


class RobotProcess:
    """`robot.py`, asked by `do`."""

    def __init__(self, workspace: Workspace) -> None:
        command = [str(PYTHON), str(Path(__file__).with_name("robot.py"))]
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(command, env=workspace.environment(), stdin=pipe, stdout=pipe, text=True)

    def do(self, what: str, **said: object) -> Any:
        """Its answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps({"do": what, **said}) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def stop(self) -> None:
        """End it."""
        self._process.communicate()
