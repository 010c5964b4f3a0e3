"""`python -m palpate.cli` is `palpate`, where the command itself is not on the path."""

import sys

from palpate.cli import main

sys.exit(main())
