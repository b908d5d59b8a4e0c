"""The loop live in a page: the machine's compiled code, run by the browser."""
