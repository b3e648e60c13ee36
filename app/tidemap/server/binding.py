"""The socket that a server listens on. Binding imports nothing large: a port in use is said at once."""

import socket


def bind(host: str, port: int) -> socket.socket:
    """A socket at the address. Raises OSError naming it."""
    bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise OSError(f"cannot listen on {host}, port {port}: {error.strerror}") from None
    bound.set_inheritable(True)
    return bound


def url_of(bound: socket.socket) -> str:
    """Where people reach it from this machine."""
    host, port = bound.getsockname()[:2]
    shown = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104
    return f"http://[{shown}]:{port}" if ":" in shown else f"http://{shown}:{port}"
