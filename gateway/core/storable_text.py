"""Text that files can hold."""


def storable(text: str) -> str:
    """Return text that UTF-8 can encode, half surrogate pairs escaped: a path may hold bytes that it cannot."""
    return text.encode("utf-8", "backslashreplace").decode()
