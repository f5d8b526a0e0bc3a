"""The engine that the options of a command ask for."""

import os
from argparse import Namespace

from boxcal.calib.fleet.engine.calls import Engine
from boxcal.calib.fleet.engine.here import ThisProcess
from boxcal.calib.fleet.engine.processes import LocalProcesses


def chosen_engine(args: Namespace, calls: int) -> tuple[Engine, list[str]]:
    """Return an engine for a number of calls, and what is to be said of it.

    Parameters
    ----------
    args
        With ``cluster``, ``jobs`` and ``time_limit``, as ``fleet-calibrate`` has them.
    calls
        How many there are to make.

    Raises
    ------
    CalibError
        If the cluster cannot be used.
    """
    if args.cluster is None or not calls:
        return local_engine(calls, workers=args.jobs, limit_s=args.time_limit), []
    from boxcal.calib.fleet.engine.connect import connect  # noqa: PLC0415  (an extra)

    return connect(args.cluster, limit_s=args.time_limit)


def local_engine(calls: int, *, workers: int | None = None, limit_s: float = float("inf")) -> Engine:
    """Return the engine of this machine for a number of calls: one that works alone needs no further process.

    Parameters
    ----------
    calls
        How many there are to make.
    workers
        Processes; as many as there are cores (and no more than calls) if None. One works in this process, where a
        call may take as long as it does.
    limit_s
        Seconds that a call may take.
    """
    workers = min(calls, workers or os.cpu_count() or 1)
    return ThisProcess() if workers <= 1 else LocalProcesses(workers, limit_s=limit_s)
