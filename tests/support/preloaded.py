"""Everything that a server imports and compiles: what `forked` has done once, before it forks."""

import app.api.main
import app.cli
import app.services.context
import app.workers.updater
import web.serve
from app.services.warm import warm

__all__ = ["app", "web"]

warm()
