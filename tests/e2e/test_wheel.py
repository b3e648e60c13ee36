"""The built wheel in fresh environments: what it holds, what the client alone needs, and how its types are seen."""

import os
import subprocess
import sys
import tarfile
import textwrap
import zipfile
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.server import ServerProcess, clean_environment

MAX_MB = 60
"""What the client and its packages may need on a robot's disk, next to the numpy that it has."""


class Environment:
    """A fresh virtual environment with the wheel, the client's packages, and numpy 1.26 where there is one."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        self.folder = folder
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
        numpy = "numpy==1.26.4" if sys.version_info < (3, 13) else "numpy"
        self._install("--no-compile", numpy)  # most of it is never imported
        self._install(str(wheel))

    def _install(self, *words: str) -> None:
        pip = [sys.executable, "-m", "pip", "--python", str(self.folder / "bin" / "python")]
        subprocess.run(
            [*pip, "install", "-q", "--disable-pip-version-check", *words], cwd=self.folder, env=_outside(), check=True
        )

    def run(self, program: str, *words: str, cwd: Path | None = None, check: bool = True) -> str:
        """The output of a program of the environment, both streams."""
        done = subprocess.run(
            [str(self.folder / "bin" / program), *words],
            cwd=cwd or self.folder,
            env=_outside(),
            capture_output=True,
            text=True,
            check=False,
        )
        if check:
            assert done.returncode == 0, done.stdout + done.stderr
        return f"{done.returncode}\n{done.stdout}{done.stderr}"

    def megabytes(self) -> float:
        """What the wheel and the packages of the client need, without numpy, pip and what is compiled on import."""
        (site,) = (self.folder / "lib").glob("python*/site-packages")
        counted = [
            file.stat().st_size
            for file in site.rglob("*")
            if file.is_file() and not file.relative_to(site).parts[0].startswith(("numpy", "pip", "setuptools"))
        ]
        return sum(counted) / 1e6


def _outside() -> dict[str, str]:
    """The environment of a program that knows nothing of this clone."""
    return {name: value for name, value in clean_environment().items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a clone's files by the pinned hatchling."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("tidemap-*.whl")
    return built


@pytest.fixture(scope="module")
def robot(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """What `pip install tidemap` gives a robot."""
    return Environment(tmp_path_factory.mktemp("robot") / "venv", wheel)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A robot's project with folders `app` and `web` of its own."""
    for name in ("app", "web"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(f"WHOSE = '{name} of the robot'\n")
    (tmp_path / "main.py").write_text(
        textwrap.dedent("""
            import app
            import web
            from tidemap import AsyncClient, Client

            print(app.WHOSE, web.WHOSE)


            def ask(tidemap: Client, later: AsyncClient) -> float:
                return tidemap.location("door").predict(0).confidence + tidemap.location("door").observe(0, 1).accepted
        """)
    )
    return tmp_path


def test_it_holds_the_two_packages_with_their_types_and_the_migrations(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"tidemap", "tidemap_web"}
    assert {"tidemap/py.typed", "tidemap_web/py.typed", "tidemap/storage/migrations/env.py"} <= set(names)
    assert not [name for name in names if "__pycache__" in name or name.startswith("tests")]


def test_the_source_distribution_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build"]
    subprocess.run([*build, "-t", "sdist", "-d", str(tmp_path)], cwd=ROOT, check=True, capture_output=True)
    (archive,) = tmp_path.glob("tidemap-*.tar.gz")
    with tarfile.open(archive) as sources:
        sources.extractall(tmp_path, filter="data")
    unpacked = archive.with_name(archive.name.removesuffix(".tar.gz"))
    assert (unpacked / "LICENSE").is_file()
    subprocess.run([*build, "-t", "wheel", "-d", str(tmp_path)], cwd=unpacked, check=True, capture_output=True)
    with zipfile.ZipFile(wheel) as one, zipfile.ZipFile(tmp_path / wheel.name) as other:
        assert sorted(one.namelist()) == sorted(other.namelist())


def test_a_project_with_folders_of_the_same_old_names_imports_it(robot: Environment, project: Path) -> None:
    assert "app of the robot web of the robot" in robot.run("python", "main.py", cwd=project)


def test_mypy_sees_its_types(robot: Environment, project: Path) -> None:
    (site,) = (robot.folder / "lib").glob("python*/site-packages")

    def check() -> str:
        words = ["-m", "mypy", "--strict", "--python-executable", str(robot.folder / "bin" / "python"), "main.py"]
        env = {name: value for name, value in os.environ.items() if name not in ("MYPYPATH", "PYTHONPATH")}
        done = subprocess.run(
            [sys.executable, *words], cwd=project, env=env, capture_output=True, text=True, check=False
        )
        return done.stdout

    assert (site / "tidemap" / "py.typed").is_file()
    assert "Success" in check()
    with (project / "main.py").open("a") as file:
        file.write(
            "\n\ndef wrong(tidemap: Client) -> str:\n    return tidemap.location('door').predict(0).confidence\n"
        )
    assert '"float", expected "str"' in check()


def test_it_is_small(robot: Environment) -> None:
    assert robot.megabytes() < MAX_MB
    assert "1\n" in robot.run("python", "-c", "import pyarrow", check=False)


def test_the_command_says_what_to_install(robot: Environment) -> None:
    assert "tidemap 0." in robot.run("tidemap", "--version")
    assert "usage: tidemap" in robot.run("tidemap", "--help")
    for words in (["serve"], ["migrate"], ["keys", "list"], ["demo"], ["verify"]):
        said = robot.run("tidemap", *words, check=False)
        assert said.startswith("1\ntidemap: ")
        assert "pip install 'tidemap[server]'" in said
        assert "Traceback" not in said


def test_the_outbox_is_looked_after_without_the_server(robot: Environment, tmp_path: Path) -> None:
    said = robot.run("tidemap", "outbox", "list", str(tmp_path / "typo.db"), check=False)
    assert said.startswith("1\n")
    assert "there is no such file" in said


def test_importing_the_package_loads_no_client(robot: Environment) -> None:
    code = "import sys, tidemap; print('httpx' in sys.modules); tidemap.Client; print('httpx' in sys.modules)"
    assert "False\nTrue" in robot.run("python", "-c", code)


def test_a_client_without_pyarrow_and_with_old_numpy_has_all_answers(
    robot: Environment, shared_server: ServerProcess, tmp_path: Path
) -> None:
    code = textwrap.dedent(f"""
        import numpy as np
        from tidemap import Client

        with Client({shared_server.url!r}) as tidemap:
            lab = tidemap.create_location(
                "light", kind="grid2d", interval_s=60, grid={{"resolution_m": 1, "shape": [3, 2]}}
            )
            for n in range(48):
                lab.observe_grid(60.0 * n, occupied=[n % 2], free=[1 - n % 2])
            lab.observe_grid(60.0 * 48, occupied=[[2, 1]])
            lab.observe_grid(60.0 * 49, grid=np.array([[1, 0], [-1, -1], [-1, 1]]))
            lab.observe([60.0 * 50, 60.0 * 51], [1, 0], [0, 1])
            assert lab.update().state == "done"
            map_then = lab.state(60.0 * 50, observed=True)
            assert map_then.cell.tolist() == [0, 1, 5], map_then
            assert map_then.dense().shape == (3, 2)
            assert map_then.dense("observed")[2, 1] == 1
            assert lab.get().observations == 48 * 2 + 1 + 3 + 2
            print("numpy", np.__version__, lab.predict(0.0).probability.shape)

        with Client({shared_server.url!r}, outbox={str(tmp_path / "outbox.db")!r}) as tidemap:
            tidemap.location("light").observe([60.0 * 60], [1], [3])
            assert tidemap.outbox.flush(30)
            assert not tidemap.outbox.refused()
    """)
    said = robot.run("python", "-W", "error", "-c", code)
    assert "(6, 1)" in said
    if sys.version_info < (3, 13):
        assert "numpy 1.26" in said


@pytest.mark.parametrize("target", [["-p", "tidemap.client", "-p", "tidemap.schemas", "-m", "tidemap.cli"]])
def test_client_and_forms_are_python_3_10(target: list[str]) -> None:
    command = [sys.executable, "-m", "mypy", "--python-version", "3.10", "--no-error-summary", *target]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
