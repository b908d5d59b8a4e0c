"""What tests of commands share."""

import webbrowser
from collections.abc import Iterator

import pytest


class Opened(webbrowser.BaseBrowser):
    """A browser that only notes what it is asked to open."""

    def __init__(self) -> None:
        super().__init__("noted")
        self.addresses: list[str] = []

    def open(self, url: str, _new: int = 0, _autoraise: bool = True) -> bool:
        """Note the address."""
        self.addresses.append(url)
        return True


@pytest.fixture
def opened() -> Iterator[list[str]]:
    """The addresses that a command opens."""
    browser = Opened()
    webbrowser.register("noted", None, browser, preferred=True)
    yield browser.addresses
    browser.addresses.clear()
