"""The program: what a user did wrong is one line on standard error and exit code 2."""

import sys
from typing import Any

import click


class Program(click.Group):
    """A group of commands that is run as a whole program."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        if not standalone_mode:
            return super().main(*args, standalone_mode=False, **extra)
        extra.setdefault("prog_name", "dntorch")
        try:
            code = super().main(*args, standalone_mode=False, **extra)
        except click.exceptions.NoArgsIsHelpError as asked:
            asked.show()
            code = 2
        except click.UsageError as error:
            code = fail(f"{error.format_message()}{_remedy(error)}")
        except click.ClickException as error:
            code = fail(error.format_message())
        except (click.Abort, KeyboardInterrupt):
            code = 130
        except ModuleNotFoundError as error:
            code = fail(f"{error}: run pip install 'dntorch[all]', or the extra that brings it")
        except MemoryError as error:
            code = fail(f"not enough memory ({error}): ask for fewer steps, runs or pixels")
        except (ValueError, OSError, ImportError) as error:
            code = fail(str(error))
        sys.exit(code)


def fail(message: str) -> int:
    """Print an error as one line; the exit code for it."""
    print("dntorch: " + " ".join(message.split()), file=sys.stderr)
    return 2


def _remedy(error: click.UsageError) -> str:
    """Where to read what there is, unless click has said what to give."""
    if isinstance(error, click.BadParameter):
        return ""
    return f" See {error.ctx.command_path if error.ctx else 'dntorch'} --help."
