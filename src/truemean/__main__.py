"""``python -m truemean`` is the command ``truemean``."""

from truemean.cli import main

if __name__ == "__main__":
    main()
