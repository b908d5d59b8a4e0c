"""`python -m gough_stewart` is the command `gough-stewart`."""

from gough_stewart.harness.cli.entry import main

if __name__ == "__main__":
    main()
