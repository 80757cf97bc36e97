"""``python -m rodgen`` is the command ``rodgen``."""

import sys

from rodgen.cli.main import main

sys.exit(main())
