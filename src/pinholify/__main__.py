"""``python -m pinholify``."""

import sys

from pinholify.cli import main

if __name__ == "__main__":
    sys.exit(main())
