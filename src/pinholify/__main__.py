"""``python -m pinholify``."""

from pinholify.cli import main

if __name__ == "__main__":
    main()
