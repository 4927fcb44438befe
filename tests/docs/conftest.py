from collections.abc import Iterator

import pytest

from tools.docs_site import accelerometer_pages


@pytest.fixture(scope="session", autouse=True)
def few_wheels() -> Iterator[None]:
    """Plan accelerometers with a tenth of the drives that the site has: its scatter is not looked at here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(accelerometer_pages, "_WHEELS", 4)
        yield
        accelerometer_pages.accelerometers_markdown.cache_clear()
