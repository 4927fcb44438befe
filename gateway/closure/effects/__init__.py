"""One physical effect a module; `catalogue` is the one list of them."""
