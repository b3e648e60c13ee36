"""What commands end with and say: 0 done, 1 failed, 2 wrong usage. Run in this process, for they are many."""

import argparse
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from tests.support.here import command
from tests.support.paths import ROOT
from tests.support.server import ServerProcess, clean_environment
from tidemap.cli import parser


def test_a_secret_alone_is_on_the_output_for_scripts(tmp_path: Path) -> None:
    assert command("migrate", "--data", str(tmp_path)).returncode == 0
    done = command("keys", "create", "--role", "operator", "--data", str(tmp_path))
    assert done.returncode == 0
    assert done.stdout.startswith("tm_")
    assert len(done.stdout.split()) == 1
    assert "once" in done.stderr


class TestBeyondLoopback:
    """Without keys the server listens to others only where it is told that somebody else checks them."""

    @pytest.mark.parametrize("host", ["0.0.0.0", "::"])
    def test_it_refuses(self, tmp_path: Path, host: str) -> None:
        refused = command("serve", "--host", host, "--port", "0", "--data", str(tmp_path))
        assert (refused.returncode, refused.stdout) == (1, "")
        assert "tidemap keys create" in refused.stderr
        assert "--open" in refused.stderr

    @pytest.mark.parametrize("host", ["192.0.2.1", "example.invalid"])
    def test_an_address_of_another_machine_is_named(self, tmp_path: Path, host: str) -> None:
        refused = command("serve", "--host", host, "--port", "0", "--data", str(tmp_path / "data"))
        assert (refused.returncode, refused.stdout) == (1, "")
        assert f"cannot listen on {host}" in refused.stderr
        assert list(tmp_path.iterdir()) == []

    def test_by_environment_it_refuses_too(self, tmp_path: Path) -> None:
        env = {"TIDEMAP_HOST": "0.0.0.0", "TIDEMAP_PORT": "0", "TIDEMAP_DATA": str(tmp_path)}
        assert command("serve", env=env).returncode == 1


class TestExitStatus:
    """0 done, 1 failed, 2 wrong usage."""

    @pytest.mark.parametrize(
        "words",
        [
            (),
            ("dance",),
            ("serve", "--colour"),
            ("serve", "--port", "many"),
            ("serve", "--port", "70000"),
            ("completion",),
            ("completion", "tcsh"),
            ("keys",),
            ("keys", "create"),
            ("keys", "create", "--role", "king"),
            ("keys", "revoke"),
            ("keys", "revoke", "x"),
            ("keys", "rotate"),
            ("keys", "rotate", "1", "--overlap", "-1"),
            ("keys", "create", "--role", "robot", "--expires", "tomorrow"),
            ("locations",),
            ("locations", "delete", "door"),
            ("locations", "rename", "door"),
            ("anomalies", "--start", "yesterday"),
            ("anomalies", "--limit", "0"),
            ("update",),
            ("update", "door", "--wait", "-1"),
            ("serve", "--data", "a", "--database-url", "b"),
        ],
        ids=" ".join,
    )
    def test_wrong_usage(self, words: tuple[str, ...]) -> None:
        done = command(*words)
        assert done.returncode == 2
        assert "usage: tidemap" in done.stderr

    @pytest.mark.parametrize(
        "words",
        [
            ("locations", "list", "--url", "127.0.0.1:8000"),
            ("demo", "--url", "ftp://127.0.0.1"),
            ("export", "door", "--format", "ply", "--key", "two words"),
            ("import", "file.bag"),
        ],
        ids=" ".join,
    )
    def test_values_that_mean_nothing(self, words: tuple[str, ...]) -> None:
        done = command(*words)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("tidemap: ")
        assert "two words" not in done.stderr

    def test_every_command_that_ends_answers_in_json(self) -> None:
        endless = {"serve", "worker", "demo", "completion"}
        silent = [path for path, leaf in leaves(parser()) if "--json" not in leaf.format_usage()]
        assert set(silent) == endless

    @pytest.mark.parametrize("words", [("--help",), ("--version",), ("serve", "--help"), ("keys", "create", "--help")])
    def test_questions_about_it(self, words: tuple[str, ...]) -> None:
        done = command(*words)
        assert (done.returncode, done.stderr) == (0, "")

    @pytest.mark.parametrize(
        ("env", "says"),
        [
            ({"TIDEMAP_PORT": "many"}, "TIDEMAP_PORT"),
            ({"TIDEMAP_PORT": "70000"}, "TIDEMAP_PORT"),
            ({"TIDEMAP_MAX_BODY_BYTES": "-1"}, "TIDEMAP_MAX_BODY_BYTES"),
            ({"TIDEMAP_UPDATE_THREADS": "0"}, "TIDEMAP_UPDATE_THREADS"),
            ({"TIDEMAP_UPDATER": "perhaps"}, "TIDEMAP_UPDATER"),
            ({"TIDEMAP_DATABASE_URL": "nonsense"}, "sqlite:///path"),
            ({"TIDEMAP_DATABASE_URL": "mysql://x/y"}, "postgresql+psycopg://"),
            ({"TIDEMAP_DATABASE_URL": "postgresql+psycopg://me:secret@127.0.0.1:1/none"}, "me:***@127.0.0.1:1/none"),
            ({"TIDEMAP_HOST": "127.0.0.1", "TIDEMAP_LOG_LEVEL": "shout"}, "TIDEMAP_LOG_LEVEL"),
        ],
        ids=lambda value: str(value)[:50],
    )
    def test_settings_that_cannot_be(self, tmp_path: Path, env: dict[str, str], says: str) -> None:
        where = () if "TIDEMAP_DATABASE_URL" in env else ("--data", str(tmp_path))
        port = () if "TIDEMAP_PORT" in env else ("--port", "0")
        done = command("serve", *where, *port, env=env)
        assert done.returncode == 1, done.stderr
        assert says in done.stderr
        assert "secret" not in done.stderr
        assert len(done.stderr) < 1000

    def test_a_port_that_is_taken(self, shared_server: ServerProcess, tmp_path: Path) -> None:
        done = command("serve", "--port", str(shared_server.port), "--data", str(tmp_path / "data"))
        assert done.returncode == 1
        assert f"port {shared_server.port}" in done.stderr
        assert list(tmp_path.iterdir()) == []

    def test_a_port_is_taken_before_anything_large_is_imported(self) -> None:
        """So that one in use is said at once: the rest is seconds of imports, and half a minute of compiling."""
        code = (
            "import socket, sys\nfrom tidemap.cli import main\n"
            "port = socket.create_server(('127.0.0.1', 0))\n"
            "status = main(['serve', '--port', str(port.getsockname()[1])])\n"
            "large = {'numpy', 'numba', 'scipy', 'fastapi', 'sqlalchemy', 'httpx', 'viser'} & sys.modules.keys()\n"
            "print(status, sorted(large))"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=ROOT, env=clean_environment(), capture_output=True, text=True, check=True
        )
        assert done.stdout == "1 []\n"

    def test_a_folder_that_cannot_be(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        done = command("serve", "--port", "0", "--data", str(tmp_path / "file" / "data"))
        assert done.returncode == 1


class TestCompletion:
    """`tidemap completion`, as shells read it."""

    def complete(self, *words: str) -> list[str]:
        """What bash offers for the last word."""
        script = command("completion", "bash").stdout
        line = f"COMP_WORDS=(tidemap {' '.join(map(repr, words))}); COMP_CWORD={len(words)}"
        ask = f'{script}\n{line}\n_shtab_tidemap\necho "${{COMPREPLY[@]}}"'
        done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
        return done.stdout.split()

    def test_bash_completes_commands_actions_options_and_choices(self) -> None:
        assert self.complete("loc") == ["locations"]
        assert set(self.complete("locations", "re")) == {"rename"}
        assert self.complete("keys", "create", "--ro") == ["--role"]
        assert self.complete("keys", "create", "--role", "ro") == ["robot"]

    @pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
    def test_every_shell_gets_every_command(self, shell: str) -> None:
        done = command("completion", shell)
        assert (done.returncode, done.stderr) == (0, "")
        for path, _ in leaves(parser()):
            assert path.split()[-1] in done.stdout
        if (found := shutil.which(shell)) is not None:
            subprocess.run([found, "-n"], input=done.stdout, text=True, check=True)


def leaves(tree: argparse.ArgumentParser, path: str = "") -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command without commands of its own, by its words."""
    groups = [action for action in tree._actions if isinstance(action, argparse._SubParsersAction)]
    if not groups:
        yield path.strip(), tree
    for group in groups:
        for name, child in group.choices.items():
            yield from leaves(child, f"{path} {name}")


class TestMigrate:
    """`tidemap migrate` and start-up on databases of other versions."""

    def test_it_makes_a_database_and_says_so_again(self, tmp_path: Path) -> None:
        for _ in range(2):
            done = command("migrate", "--data", str(tmp_path))
            assert (done.returncode, done.stderr) == (0, "")
        assert (tmp_path / "tidemap.db").is_file()

    @pytest.mark.parametrize(
        "words",
        [("migrate",), ("serve", "--port", "0"), ("keys", "list"), ("keys", "create", "--role", "robot")],
        ids=" ".join,
    )
    def test_a_newer_schema_is_left_alone(self, tmp_path: Path, words: tuple[str, ...]) -> None:
        command("migrate", "--data", str(tmp_path))
        with closing(sqlite3.connect(tmp_path / "tidemap.db")) as database:
            database.execute("UPDATE alembic_version SET version_num = '9999_from_the_future'")
            database.commit()
        done = command(*words, "--data", str(tmp_path))
        assert (done.returncode, done.stdout) == (1, "")
        assert "9999_from_the_future" in done.stderr
        assert "Upgrade Tidemap" in done.stderr
        with closing(sqlite3.connect(tmp_path / "tidemap.db")) as database:
            assert database.execute("SELECT version_num FROM alembic_version").fetchall() == [("9999_from_the_future",)]

    def test_a_file_that_is_no_database(self, tmp_path: Path) -> None:
        (tmp_path / "tidemap.db").write_text("this is a letter, not a database" * 100)
        for words in (("migrate",), ("serve", "--port", "0"), ("keys", "list")):
            done = command(*words, "--data", str(tmp_path))
            assert done.returncode == 1
            assert "database" in done.stderr

    @pytest.mark.parametrize(
        ("words", "status"),
        [
            (("keys", "list"), 1),
            (("keys", "create", "--role", "admin"), 1),
            (("keys", "rotate", "1"), 1),
            (("keys", "revoke", "1"), 1),
            (("verify",), 2),
            (("backup", "copy.db"), 1),
            (("worker",), 1),
        ],
        ids=str,
    )
    def test_a_folder_that_is_not_there_is_not_made(self, tmp_path: Path, words: tuple[str, ...], status: int) -> None:
        missing = tmp_path / "typo"
        done = command(*words, "--data", str(missing))
        assert (done.returncode, done.stdout) == (status, "")
        assert str(missing / "tidemap.db") in done.stderr
        assert "tidemap migrate" in done.stderr
        assert list(tmp_path.iterdir()) == []
