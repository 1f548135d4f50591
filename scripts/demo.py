"""Makes the environment, then fills a demo clip from the starter database.

Run ``python scripts/demo.py``, with arguments of ``priorfill demo``.
"""

import python_version  # noqa: F401  # ends here on a Python that is too old

# isort: split
import sys

from checkout import demo

if __name__ == "__main__":
    sys.exit(demo(sys.argv[1:]))
