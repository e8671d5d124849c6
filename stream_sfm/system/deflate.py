"""`zlib`, by ISA-L where available: it decompresses and computes checksums three times as fast."""

import zlib as _standard
from typing import Any

zlib: Any
try:
    from isal import isal_zlib
except ImportError:
    zlib = _standard
else:
    zlib = isal_zlib
