"""``python -m leafwarp``."""

import sys

from leafwarp.cli import main

if __name__ == "__main__":
    sys.exit(main())
