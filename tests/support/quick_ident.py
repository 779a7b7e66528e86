"""`ident`, its programs compiled as the tests compile theirs: python quick_ident.py COMMAND ..."""

import quickly  # noqa: F401

from ident import cli

cli.main()
