"""`python -m gateway.cli` is `treadlink`."""

from gateway.cli import main

if __name__ == "__main__":
    main()
