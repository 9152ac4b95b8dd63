"""`python -m epiline` is the command `epiline`."""

import sys

from epiline.cli import main

sys.exit(main())
