"""`python -m priorfill`: the command line, for when its folder is not on the search path."""

from __future__ import annotations

from priorfill.cli import main

if __name__ == "__main__":
    main()
