"""`python -m fitball` is the command line."""

import sys

from fitball.cli import main

if __name__ == "__main__":
    sys.exit(main())
