"""The connection to a robot's server: made, told apart by protocol, and made again when it is lost."""

import asyncio
from typing import TYPE_CHECKING

from boxcal.calib.guide.sources.foxglove import SUBPROTOCOLS, FoxgloveListener
from boxcal.calib.guide.sources.link import Link
from boxcal.calib.guide.sources.rosbridge import RosbridgeListener
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.base import MAX_RECORD_BYTES
from boxcal.detect.log.safe_text import printable

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

_OPEN_S, _PING_S = 5.0, 5.0
_WAIT_S, _LONGEST_WAIT_S = 0.5, 5.0
_HELD = 8
"""Messages that the connection holds unread; beyond them the server's own buffer fills, and drops."""
_FIRST_WORD_S = 1.0


async def follow_server(link: Link) -> None:
    """Listen to the server at ``link.address`` until the link is stopped; reconnect whenever it is lost."""
    import websockets  # noqa: PLC0415  of the extra live
    from websockets.asyncio.client import connect  # noqa: PLC0415

    wait = _WAIT_S
    while not link.stopped.is_set():
        try:
            async with connect(
                link.address,
                subprotocols=[websockets.Subprotocol(name) for name in SUBPROTOCOLS],
                max_size=MAX_RECORD_BYTES,
                max_queue=_HELD,
                compression=None,
                open_timeout=_OPEN_S,
                ping_interval=_PING_S,
                ping_timeout=2 * _PING_S,
                close_timeout=1,
                proxy=None,
            ) as socket:
                await _until_stopped(socket, link)
            link.lost("the connection was closed by the robot")
        except (websockets.InvalidURI, ValueError) as error:
            why = str(error).replace(link.address, link.name)
            link.lost(f"not an address ({printable(why[:80])}); ws://robot:8765 is one")
        except websockets.InvalidHandshake as error:
            link.lost(
                f"the server there refuses the Foxglove protocol {' or '.join(SUBPROTOCOLS)} "
                f"({printable(str(error)[:120])}); update foxglove_bridge, or give the port of rosbridge"
            )
        except websockets.ConnectionClosed as error:
            link.lost(_closed(error))
        except TimeoutError:
            link.lost(f"no answer within {_OPEN_S:g} s; is the robot on this network?")
        except OSError as error:
            link.lost(f"no bridge there ({error.strerror or error}); start foxglove_bridge or rosbridge on the robot")
        except DetectError as error:
            link.lost(str(error))
        wait = _WAIT_S if link.losses else min(2 * wait, _LONGEST_WAIT_S)
        for _ in range(round(wait / 0.1)):
            if link.stopped.is_set():
                return
            await asyncio.sleep(0.1)


async def _until_stopped(socket: "ClientConnection", link: Link) -> None:
    """Listen until the connection ends or the link is stopped."""
    listening = asyncio.create_task(_listen(socket, link))
    while not link.stopped.is_set():
        done, _ = await asyncio.wait([listening], timeout=0.1)
        if done:
            break
    else:
        await socket.close()
    await listening


async def _listen(socket: "ClientConnection", link: Link) -> None:
    """Listen by the protocol that the server speaks: rosbridge knows no subprotocol and says nothing by itself."""
    if socket.subprotocol is not None:
        await FoxgloveListener(socket, link).run()
        return
    try:
        first = await asyncio.wait_for(socket.recv(), _FIRST_WORD_S)
    except TimeoutError:
        await RosbridgeListener(socket, link).run()
        return
    await FoxgloveListener(socket, link).run(first)


def _closed(error: Exception) -> str:
    """Return why a connection ended, in a sentence."""
    sent = getattr(error, "sent", None)
    if sent is not None and sent.code == 1009:
        return f"a message of more than {MAX_RECORD_BYTES >> 20} MB was refused; publish smaller pictures"
    return "the connection was lost"
