"""Makes the environment; style and types: ruff (lint and format), mypy."""

import python_version  # noqa: F401  # ends here on a Python that is too old

# isort: split
import sys

from checkout import check

if __name__ == "__main__":
    sys.exit(check())
