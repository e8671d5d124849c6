"""`python -m stream_sfm` is `stream-sfm`."""

import sys

from .cli.main import main

sys.exit(main())
