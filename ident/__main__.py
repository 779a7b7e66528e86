"""`python -m ident` is `ident`."""

from ident.cli import main

main()
