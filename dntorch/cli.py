"""The command line: entry point."""

import sys

from dntorch.process import open_streams


def main() -> None:
    """Entry point: errors of the user are one line on standard error and exit code 2."""
    open_streams()
    try:
        from dntorch.commands import dntorch
    except ImportError as error:
        print(f"dntorch: {error}: run pip install 'dntorch[cli,sim]'", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:  # before there is a command to stop
        sys.exit(130)
    dntorch()


if __name__ == "__main__":
    main()
