"""Every setting of the server on one page. Each can be set as an environment variable `TIDEMAP_<NAME>`."""

import ipaddress
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from tidemap.media_types import JSON


@lru_cache(maxsize=256)
def is_loopback(host: str) -> bool:
    """Whether only this machine reaches the address.

    >>> [is_loopback(host) for host in ("127.0.0.1", "::1", "localhost", "0.0.0.0", "example.org")]
    [True, True, True, False, False]
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


DAY_S = 86400.0
WEEK_S = 7 * DAY_S
YEAR_S = 365.25 * DAY_S


class Settings(BaseSettings):
    """Settings with their defaults; a bad value refuses to start and says which."""

    model_config = SettingsConfigDict(env_prefix="TIDEMAP_", extra="ignore", frozen=True)

    # Where
    data: Path = Field(Path("data"), description="Folder of the embedded SQLite database.")
    database_url: str | None = Field(
        None, description="A SQLAlchemy URL (postgresql+psycopg://…); without one, SQLite in `data`."
    )
    host: str = Field("127.0.0.1", description="Address to listen on. Beyond loopback a key must exist.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0 lets the system choose one.")
    open: bool = Field(False, description="Listen anywhere without keys: only behind a gateway that checks them.")

    # Limits
    max_body_bytes: int = Field(128 * 2**20, gt=0, description="Largest body of a request, unpacked.")
    max_json_bytes: int = Field(
        16 * 2**20,
        gt=0,
        description="Largest JSON body, unpacked; read, it takes up to 24 times its size. Send more as Arrow or npy.",
    )
    max_parsing_bytes: int = Field(
        512 * 2**20,
        gt=0,
        description="Memory for all bodies that are being read and parsed; more wait a little or are refused (503). "
        "One body may exceed it: an Arrow or npy body takes up to 12 times its size, JSON up to 24 times, a grid of "
        "bytes up to 156 times.",
    )
    max_cells: int = Field(200_000_000, gt=0, le=2**28, description="Largest number of cells of one location.")
    whole_cells: int = Field(
        16_000_000,
        gt=0,
        description="Largest number of cells that are held at once: of a location with more, questions are about a "
        "region, and only the parts of it that were ever seen are stored.",
    )
    max_points: int = Field(1_000_000, gt=0, description="Largest number of values in a predict or series answer.")
    max_samples: int = Field(
        4 * 2**20,
        gt=0,
        description="Longest window of a model in samples; older history is kept but not modelled.",
    )
    future_s: float = Field(3600.0, ge=0, description="How far ahead of the server's clock a measurement may be.")
    past_s: float = Field(
        19 * YEAR_S,
        ge=0,
        description="… and how far behind it, 19 years: archives can be imported, while a clock that lost its battery "
        "(1970, 1980, 2000) or a GPS receiver that forgot a rollover (19.6 years slow) is noticed.",
    )

    # How many requests
    requests_per_s: float = Field(
        200.0,
        ge=0,
        description="Requests a second of one key, or of one address beyond loopback where no key is needed; more are "
        "refused (429). 0: no limit. A proxy's clients are told apart where FORWARDED_ALLOW_IPS names the proxy.",
    )
    requests_burst: int = Field(1000, gt=0, description="… and at most so many at once.")
    wrong_keys_per_minute: float = Field(
        60.0,
        ge=0,
        description="Wrong keys a minute from one address; more are not even looked at (429), but keys that were right "
        "lately go on. 0: no limit.",
    )

    max_connections: int = Field(1000, gt=0, description="Open connections; one more is refused (503).")
    max_connections_per_address: int = Field(
        500,
        gt=0,
        description="… from one address. All that come through a proxy have the proxy's: let it bound its own clients.",
    )

    # Writing
    commit_queue: int = Field(1024, gt=0, description="Writes that may wait for the writer; more are refused (503).")
    commit_batch: int = Field(128, gt=0, description="Most writes in one group commit.")

    # Keeping
    idempotency_s: float = Field(
        WEEK_S, ge=WEEK_S, description="How long a post can be sent again under its Idempotency-Key and be stored once."
    )
    scans_s: float = Field(
        30 * DAY_S,
        ge=0,
        description="How long it is listed what became of a scan; points in quarantine go with that.",
    )
    jobs_s: float = Field(30 * DAY_S, ge=0, description="How long finished jobs are listed; the last ten stay longer.")

    # Updating by itself
    updater: bool = Field(
        True, description="Refit locations and compact their logs in the background when they have grown."
    )
    updater_interval_s: float = Field(
        5.0, gt=0, description="How often the updater and the compactor look for what has grown."
    )
    update_samples: int = Field(
        2,
        gt=0,
        description="Measurements of a location from which on it has its first update, however far apart; few make a "
        "cautious mean.",
    )
    update_growth: float = Field(
        0.1,
        gt=0,
        description="Refit when the measurements since the last update reach this share of those before.",
    )
    update_latest_s: float = Field(
        DAY_S, gt=0, description="… or, where there are any at all, so long after the last update."
    )
    update_rest_s: float = Field(30.0, ge=0, description="At least this long is between two updates.")
    update_threads: int = Field(2, gt=0, description="Threads one update may use, or a worker of a Dask cluster.")
    dask_scheduler: str | None = Field(
        None,
        description="Address of a Dask scheduler (tcp://…, tls://…): updates run on the workers of its cluster, and "
        "`tidemap worker` starts one. It must share the database, and nobody else may reach it: it runs any code.",
    )

    # Reading and streaming
    history_cache_bytes: int = Field(
        256 * 2**20, ge=0, description="Memory for unpacked history, and as much for what the viewer shows of it."
    )
    spectrum_cache_bytes: int = Field(512 * 2**20, ge=0, description="Memory for spectra.")
    reading_cache_bytes: int = Field(
        128 * 2**20, ge=0, description="Memory for what was read last of each cell, 17 to 20 bytes a cell."
    )
    surface_cache_bytes: int = Field(
        64 * 2**20, ge=0, description="Memory for the expected surfaces that scans are aligned to, 160 bytes a cell."
    )
    answer_cache_bytes: int = Field(
        64 * 2**20,
        ge=0,
        description="Memory for Arrow answers about whole maps, 14 bytes a cell, 23 with what was last seen; the next "
        "question about a map only writes anew what changes.",
    )
    socket_queue: int = Field(
        256,
        gt=0,
        description="Events a reader of the WebSocket or the event stream may lag behind before it is dropped.",
    )
    webhooks_private: bool = Field(
        False, description="Let webhooks go to private and loopback addresses, and without https."
    )
    secret_file: Path | None = Field(
        None,
        description="File with the key that secrets of webhooks are derived from, made with the first webhook; by "
        "default `secret.key` in `data`. Servers of one database share it. Keep a copy, apart from the database's.",
    )
    viewer: bool = Field(True, description="Run the 3D viewer.")
    max_stop_s: float = Field(
        25.0,
        gt=0,
        description="How long stopping takes at most, with the ten seconds in which requests are answered; then the "
        "process ends by force and says what a database that hangs was asked for.",
    )
    viewer_tabs: int = Field(
        50,
        gt=0,
        description="Tabs of the viewer that may be open with one key, or all of them where no key is needed; one more "
        "is refused and says so. Each has a thread, and takes memory as its map is large.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = Field("info", description="How much to log.")
    log_format: Literal["text", "json"] = Field("text", description="Lines for people, or an object of JSON a line.")
    access_log: bool = Field(False, description="Log every request: method, path, status, time and address.")
    cors_origins: tuple[str, ...] = Field(
        (),
        description='Sites whose pages may ask this server from a browser, as `["https://dashboard.example"]`; they '
        "send a key, for no cookie of this server is sent along.",
    )

    @field_validator("database_url")
    @classmethod
    def _known_database(cls, url: str | None) -> str | None:
        if url is not None and not url.startswith(("postgresql+psycopg://", "sqlite:///")):
            raise ValueError("give postgresql+psycopg://user@host/name, or sqlite:///path")
        return url

    @field_validator("dask_scheduler")
    @classmethod
    def _reachable_scheduler(cls, address: str | None) -> str | None:
        if address is not None and not address.startswith(("tcp://", "tls://")):
            raise ValueError("give tcp://host:port, or tls://host:port")
        if address is not None and find_spec("distributed") is None:
            raise ValueError("updates on Dask need its package; run: pip install 'tidemap[dask]'")
        return address

    @property
    def keyless(self) -> bool:
        """Whether no key is needed while none exists: on loopback, or behind somebody else's gateway."""
        return self.open or is_loopback(self.host)

    def body_limit(self, media_type: str) -> int:
        """Largest body of a media type in bytes."""
        return min(self.max_body_bytes, self.max_json_bytes) if media_type == JSON else self.max_body_bytes

    @property
    def secret_path(self) -> Path:
        """Where the key that secrets are derived from lies."""
        return self.secret_file or self.data / "secret.key"

    @property
    def url(self) -> str:
        """The database as a SQLAlchemy URL."""
        return self.database_url or f"sqlite:///{quote((self.data / 'tidemap.db').as_posix())}"
