"""The `aerofed` command as `python -m aerofed`."""

from mission.__main__ import main

if __name__ == "__main__":
    main()
