"""The command ``softshadow``, which says what to install where its own packages are missing."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command line and return the exit code."""
    try:
        from softshadow import cli
    except ModuleNotFoundError as error:
        print("error:", error, file=sys.stderr)
        return 2
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
