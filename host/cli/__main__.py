"""`python -m host.cli` is `palpate`, where the command itself is not on the path."""

import sys

from host.cli import main

sys.exit(main())
