"""The command line: entry point and errors."""

import sys

from dntorch.process import open_streams


def main() -> None:
    """Entry point: errors of the user are one line on standard error and exit code 2."""
    open_streams()
    try:
        import click

        from dntorch.commands import dntorch
    except ImportError as error:
        sys.exit(_fail(f"{error}: run pip install 'dntorch[cli,sim]'"))
    try:
        sys.exit(dntorch.main(prog_name="dntorch", standalone_mode=False))
    except click.exceptions.NoArgsIsHelpError as help:
        help.show()
        sys.exit(2)
    except click.ClickException as error:
        sys.exit(_fail(error.format_message()))
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    except ModuleNotFoundError as error:
        sys.exit(_fail(f"{error}: run pip install 'dntorch[all]', or the extra that brings it"))
    except (ValueError, OSError, ImportError) as error:
        sys.exit(_fail(str(error)))


def _fail(message: str) -> int:
    print("dntorch: " + " ".join(message.split()), file=sys.stderr)
    return 2


if __name__ == "__main__":
    main()
