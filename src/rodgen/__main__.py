"""``python -m rodgen`` is the command ``rodgen``."""

import sys

from rodgen.cli import main

sys.exit(main())
