"""The app as it runs: served on this computer, by a thread of the tests, over photographs rendered here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from running_app import App, new_session, opened, running

from pinholify.io.images import write_image
from small_camera import SMALL


@pytest.fixture(scope="session")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    with running(tmp_path_factory.mktemp("app")) as served:
        yield served


@pytest.fixture
def client(app: App) -> Iterator[httpx.Client]:
    """A client that has opened the page."""
    with opened(app) as client:
        yield client


@pytest.fixture
def session(client: httpx.Client) -> Iterator[str]:
    """A new session whose board is not known."""
    made = new_session(client)
    yield made
    client.delete(f"/api/sessions/{made}")


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Twelve photographs of a 9x6 board by the small camera, the first board filling the frame."""
    folder = tmp_path_factory.mktemp("photographs")
    paths = []
    for picture in replace(SMALL, views=12).photographs():
        paths.append(folder / f"{picture.name}.png")
        write_image(paths[-1], picture.image)
    return paths
