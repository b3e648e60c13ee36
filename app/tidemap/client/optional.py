"""pyarrow where it is installed (the extra `arrow`): `pa`, else None."""

from typing import Any

try:
    import pyarrow
except ImportError:
    pyarrow = None

pa: Any = pyarrow
