"""The client alone: what a robot without the server installed can import."""

import subprocess
import sys

from tests.support.paths import ROOT

SERVER_ONLY = {
    "scipy",
    "fastapi",
    "sqlalchemy",
    "numba",
    "starlette",
    "uvicorn",
    "pydantic_settings",
    "orjson",
    "tqdm",
}


def test_importing_the_client_imports_no_server_package() -> None:
    code = "import sys, tidemap.client; print('\\n'.join({name.split('.')[0] for name in sys.modules}))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    imported = set(run.stdout.split())
    assert "httpx" in imported
    assert not imported & SERVER_ONLY


def test_operations_document_themselves_like_methods() -> None:
    import inspect

    from tidemap.client import AsyncLocationHandle, LocationHandle

    for handle in (LocationHandle, AsyncLocationHandle):
        assert "confidence" in inspect.signature(handle.state).parameters
        assert handle.observe.__doc__


def test_the_version_is_that_of_the_package() -> None:
    import tomllib

    import tidemap

    assert tidemap.__version__ == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_the_client_is_imported_from_the_package_and_nothing_else_is() -> None:
    import tidemap
    from tidemap import client

    assert (tidemap.Client, tidemap.AsyncClient) == (client.Client, client.AsyncClient)
    assert not hasattr(tidemap, "TidemapError")
