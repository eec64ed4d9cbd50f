"""The page on the ground: what comes, in a browser or in Foxglove, and the commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ftp_dent_ros.errors import ConfigurationError

if TYPE_CHECKING:
    from ftp_dent_ros.ground.page.server import PageServer
    from ftp_dent_ros.ground.station import Station


def serve_page(address: str, station: Station) -> PageServer:
    """Serve the page of a station at ``HOST:PORT``: it shows what comes, its buttons command.

    Raises
    ------
    ConfigurationError
        aiohttp or rosbags is not installed, or the address cannot be listened on.
    """
    try:
        from ftp_dent_ros.ground.page.server import PageServer
    except ModuleNotFoundError as missing:
        raise ConfigurationError(
            f'the page needs {missing.name}, which is not installed: install it with '
            "`pip install '.[ground,bags]'`"
        ) from None

    def link() -> dict[str, Any]:
        level, text = station.summary()
        return {'level': level, 'text': text, 'rate': round(8e-3 * station.rate())}

    return PageServer(address, link, station.command)
