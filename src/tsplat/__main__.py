"""The command ``tsplat``, which is ``python -m tsplat`` as well."""

import sys

from tsplat._search_path import ignore_current_folder


def main() -> int:
    """Run the command line; see `tsplat.cli.main`."""
    ignore_current_folder()  # before anything else is imported
    from tsplat.cli import main as run
    from tsplat.standard_streams import open_closed_streams

    open_closed_streams()
    return run()


if __name__ == "__main__":
    sys.exit(main())
