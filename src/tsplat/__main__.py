"""``python -m tsplat`` is the command ``tsplat``."""

import sys

from tsplat.cli import main

sys.exit(main())
