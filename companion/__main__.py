"""`python -m companion`: the same as the `companion` command."""

from companion.safe_path import leave_current_directory

if __name__ == "__main__":
    leave_current_directory()  # before anything else is imported
    from companion.cli import main

    main()
