"""nginx and Caddy as docker/proxies configures them, before a running server, with TLS on a port of loopback."""

import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.programs import program
from tests.support.server import ServerProcess
from tests.support.waiting import WAIT_S

EXAMPLES = ROOT / "docker" / "proxies"
AROUND_NGINX = """
pid {folder}/pid;
error_log {folder}/error.log;
daemon off;
{user}
worker_processes 1;
events {{ worker_connections 1024; }}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
{site}
}}
"""


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate of localhost that signs itself, and its key."""
    cert, key = folder / "tls.crt", folder / "tls.key"
    names = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost"]
    kind = ["-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2"]
    command = [str(program("openssl")), "req", *kind, *names, "-keyout", str(key), "-out", str(cert)]
    subprocess.run(command, check=True, capture_output=True)
    return cert, key


@contextmanager
def nginx(server: ServerProcess, folder: Path, **changed: str) -> Iterator[str]:
    """The address of nginx before a server; `changed` lines of the example are others."""
    executable, (cert, key), port = program("nginx"), certificate(folder), free_port()
    site = (EXAMPLES / "nginx.conf").read_text()
    for line, other in {
        "listen 443 ssl": f"listen 127.0.0.1:{port} ssl",
        "server_name map.example.com": "server_name localhost",
        "/etc/ssl/tidemap.crt": str(cert),
        "/etc/ssl/tidemap.key": str(key),
        "127.0.0.1:8000": f"127.0.0.1:{server.port}",
        **changed,
    }.items():
        assert line in site, line
        site = site.replace(line, other)
    config = folder / "nginx.conf"
    # Its workers are those of the user who runs the tests, who may read the folder.
    config.write_text(AROUND_NGINX.format(folder=folder, site=site, user="user root;" if _is_root() else ""))
    command = [str(executable), "-p", str(folder), "-c", str(config), "-e", str(folder / "error.log")]
    with _running(command, port, folder):
        yield f"https://localhost:{port}"


@contextmanager
def caddy(server: ServerProcess, folder: Path) -> Iterator[str]:
    """The address of Caddy before a server."""
    executable, (cert, key), port = program("caddy"), certificate(folder), free_port()
    site = (EXAMPLES / "Caddyfile").read_text()
    first = f"https://localhost:{port} {{\n\tbind 127.0.0.1\n\ttls {cert} {key}"
    site = site.replace("map.example.com {", first).replace("127.0.0.1:8000", f"127.0.0.1:{server.port}")
    config = folder / "Caddyfile"
    config.write_text("{\n\tadmin off\n\tauto_https disable_redirects\n\tskip_install_trust\n}\n" + site)
    command = [str(executable), "run", "--config", str(config), "--adapter", "caddyfile"]
    with _running(command, port, folder):
        yield f"https://localhost:{port}"


PROXIES = {"nginx": nginx, "caddy": caddy}


@contextmanager
def _running(command: list[str], port: int, folder: Path) -> Iterator[None]:
    log = folder / "proxy.log"
    env = {"HOME": str(folder), "XDG_DATA_HOME": str(folder), "XDG_CONFIG_HOME": str(folder)}
    with log.open("wb") as output:
        process = subprocess.Popen(command, cwd=folder, env=env, stdout=output, stderr=output)
    try:
        deadline = time.monotonic() + WAIT_S
        while not _listens(port):
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.02)
        yield
    finally:
        process.terminate()
        process.wait(WAIT_S)


def _listens(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def free_port() -> int:
    """A port that nobody listens on now."""
    with socket.create_server(("127.0.0.1", 0)) as bound:
        return int(bound.getsockname()[1])


def _is_root() -> bool:
    return Path("/proc/self").stat().st_uid == 0
