"""A recording that another program is writing, followed as it grows."""

import asyncio
from pathlib import Path

from boxcal.calib.guide.sources.link import Link
from boxcal.detect.errors import DetectError
from boxcal.detect.log.containers.mcap_growing import GrowingMcap

_EVERY_S = 0.2


async def follow_file(link: Link, path: Path) -> None:
    """Hand on the messages of an MCAP file as it grows, until the link is stopped or the file is finished.

    What stands in the file already is read first, as fast as it can be; again where another camera is named.
    """
    while not link.stopped.is_set():
        try:
            with path.open("rb", buffering=0) as file:
                reader, choices = GrowingMcap(file, path.name), link.choices
                link.found()
                while not link.stopped.is_set() and link.choices == choices:
                    if reader.finished:
                        link.lost("the recording is finished")
                    if reader.finished or not await _pass_on(link, reader):
                        await asyncio.sleep(_EVERY_S)
                continue
        except FileNotFoundError:
            link.lost(f"no file {path.name} yet; it is waited for")
        except OSError as error:
            link.lost(f"{path.name}: cannot be read ({error.strerror or error})")
        except DetectError as error:
            link.lost(str(error))
            return
        await asyncio.sleep(1.0)


async def _pass_on(link: Link, reader: GrowingMcap) -> bool:
    """Hand on what has come; return whether anything has. Images come at the rate at which they were recorded."""
    any_came = False
    for batches in reader.grown():
        link.offer(reader.channels)
        messages = [
            (log, batch.channel, data)
            for batch in batches
            if batch.channel.topic in link.selection.topics
            for data, log in batch.messages()
        ]
        for log, channel, data in sorted(messages, key=lambda m: m[0]):
            while link.is_full and not link.stopped.is_set():
                await asyncio.sleep(0.02)
            link.hand_on(channel, log, data, now=log / 1e9)
        any_came = any_came or bool(messages)
        await asyncio.sleep(0)
    return any_came


def is_file(source: str) -> bool:
    """Return whether a source is a file and no server's address."""
    return "://" not in source
