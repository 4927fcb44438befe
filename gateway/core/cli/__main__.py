"""Entry point of `python -m gateway.core.cli`."""

from gateway.core.cli import main

if __name__ == "__main__":
    main()
