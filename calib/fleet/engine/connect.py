"""Connection to a Dask cluster: its scheduler found, its workers' versions compared with those here."""

import logging
import re
from pathlib import Path
from typing import Any

from boxcal.calib.errors import CalibError
from boxcal.calib.fleet.engine.compared_workers import ComparedWorkers
from boxcal.calib.fleet.engine.dask_cluster import DaskCluster
from boxcal.detect.log.safe_text import printable

CONFIGURED = "configured"
"""Stands for the scheduler that Dask's own configuration names."""
_ADDRESS = re.compile(r"([a-z]+://)?[^\s/]+:\d+/?")
_ANSWER_S = 10.0
"""Seconds that a scheduler is given to answer."""


def connect(scheduler: str, *, limit_s: float, silent_s: float = 60.0) -> tuple[DaskCluster, list[str]]:
    """Return an engine on a cluster's workers, and what is to be said of them.

    Parameters
    ----------
    scheduler
        Its address (``tcp://host:8786``), its file (``.json``), or ``configured``: what Dask's configuration names
        (``DASK_SCHEDULER_ADDRESS``, or its YAML files, which hold TLS keys too).
    limit_s, silent_s
        As :class:`DaskCluster` has them.

    Raises
    ------
    CalibError
        If the extra is missing, no scheduler answers, or no worker can be used.
    """
    name = printable(scheduler.rpartition("@")[2])
    client = _client(scheduler, name)
    try:
        found = list(client.scheduler_info(n_workers=-1)["workers"])
        if not found:
            raise CalibError("a cluster without workers", source=name, remedy="start some: dask worker " + name)
        compared = ComparedWorkers(client)
        remarks = compared.wait(found)
        if not compared.usable:
            raise CalibError(f"no worker can be used: {'; '.join(remarks)}", source=name)
    except BaseException:
        client.close()
        raise
    cluster = DaskCluster(client, compared, limit_s=limit_s, silent_s=silent_s)
    return cluster, [f"cluster {name}: {len(compared.usable)} workers", *remarks]


def _client(scheduler: str, name: str) -> Any:
    try:
        import dask  # noqa: PLC0415  (an extra)
        from distributed import Client  # noqa: PLC0415
    except ImportError as error:
        raise CalibError(
            "--cluster needs an extra that is not installed", remedy="pip install 'boxcal[cluster]'"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what happens is said in lines of our own
    place: dict[str, Any] = {"address": scheduler}
    if scheduler == CONFIGURED:
        configured = dask.config.get("scheduler-address", None)
        if not configured:
            raise CalibError(
                "Dask's configuration names no scheduler",
                source=f"--cluster {CONFIGURED}",
                remedy="set DASK_SCHEDULER_ADDRESS, or give the address",
            )
        place = {"address": configured}
    elif scheduler.endswith(".json"):
        if not Path(scheduler).is_file():  # Dask would wait for it for ever
            raise _absent(name, "no such file")
        place = {"scheduler_file": scheduler}
    elif not _ADDRESS.fullmatch(scheduler):  # Dask may wait for that, too
        raise _absent(name, "no address")
    try:
        return Client(**place, timeout=_ANSWER_S, set_as_default=False)
    except Exception as error:  # of many kinds, after the address that was given
        raise _absent(name, type(error).__name__) from error


def _absent(name: str, why: str) -> CalibError:
    return CalibError(
        f"no scheduler answers there ({why})",
        source=name,
        needed="a Dask scheduler, as tcp://host:8786",
        remedy="start one (dask scheduler), or leave out --cluster to work on this machine",
    )
