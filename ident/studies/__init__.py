"""One file a capability: its options, its result, and the function that `ident` offers under the same name."""
