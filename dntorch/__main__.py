"""``python -m dntorch``: the command line."""

from dntorch.cli import main

if __name__ == "__main__":
    main()
