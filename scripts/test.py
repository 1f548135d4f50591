"""Makes the environment; style, types, and all tests on all cores, as in CI.

Run ``python scripts/test.py``, with arguments of pytest.
"""

import python_version  # noqa: F401  # ends here on a Python that is too old

# isort: split
import sys

from checkout import test

if __name__ == "__main__":
    sys.exit(test(sys.argv[1:]))
