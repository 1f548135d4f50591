"""Makes the environment that the other scripts use (.venv in the checkout) and prints its path.

Takes a fraction of a second if the environment is up to date, and needs the network only if it is
not. ``PRIORFILL_VENV`` puts it elsewhere.
"""

import python_version  # noqa: F401  # ends here on a Python that is too old

# isort: split
import sys

from checkout import environment

if __name__ == "__main__":
    sys.stdout.write(str(environment()) + "\n")
