"""Sources: one module a kind of file. `opening` has the list of them."""
