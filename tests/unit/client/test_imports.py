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
