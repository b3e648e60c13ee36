"""Everything that a server imports and compiles: what `forked` has done once, before it forks."""

import tidemap.api.main
import tidemap.cli
import tidemap.server.serving
import tidemap.services.context
import tidemap.workers.updater
import tidemap_web.site
from tidemap.services.warm import warm

__all__ = ["tidemap", "tidemap_web"]

warm()
