"""Engines: calls made in this process and in processes of this machine, some of which are killed or frozen."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from boxcal.calib.fleet.engine.calls import Call, Engine
from boxcal.calib.fleet.engine.here import ThisProcess
from boxcal.calib.fleet.engine.processes import LocalProcesses
from boxcal.calib.fleet.engine.telling import tell


def _square(number: int) -> int:
    tell(f"squaring {number}")
    return number**2


def _unlucky(number: int, folder: Path, fault: str, times: int) -> int:
    """The square of a number, but at the first few times for which this process is lost instead."""
    count = len(list(folder.glob(f"{number}-*")))
    if count < times:
        (folder / f"{number}-{count}").touch()
        if fault == "memory":
            raise MemoryError
        if fault == "raise":
            raise ValueError(number)
        os.kill(os.getpid(), {"die": signal.SIGKILL, "freeze": signal.SIGSTOP}[fault])
        time.sleep(60)
    return number**2


@pytest.fixture(params=["here", "processes"])
def engine(request: pytest.FixtureRequest) -> Iterator[Engine]:
    with ThisProcess() if request.param == "here" else LocalProcesses(2) as made:
        yield made


def test_engines_make_every_call_and_pass_on_what_is_told(engine: Engine) -> None:
    heard: list[str] = []
    for _ in range(2):
        calls = (Call(key=str(k), function=_square, arguments=(k,)) for k in range(20))
        found = {done.call.key: done.result for done in engine.run(calls, heard.append)}
        assert found == {str(k): k**2 for k in range(20)}
    assert sorted(heard) == sorted(2 * [f"squaring {k}" for k in range(20)])


def test_engines_take_calls_only_when_there_is_somewhere_to_make_them(engine: Engine) -> None:
    taken = 0

    def calls() -> Iterator[Call[int]]:
        nonlocal taken
        for k in range(20):
            taken += 1
            yield Call(key=str(k), function=_square, arguments=(k,))

    running = engine.run(calls())
    next(running)
    assert taken <= 5
    running.close()
    assert taken <= 5
    assert [done.result for done in engine.run([Call(key="7", function=_square, arguments=(7,))])] == [49]


def test_what_a_call_raises_is_said_and_the_others_go_on(engine: Engine, tmp_path: Path) -> None:
    calls = [Call(key="1", function=_unlucky, arguments=(1, tmp_path, "raise", 9))]
    calls += [Call(key=str(k), function=_unlucky, arguments=(k, tmp_path, "raise", 0)) for k in range(2, 5)]
    found = {done.call.key: done for done in engine.run(calls)}
    assert found["1"].lost == "unexpected ValueError: 1"
    assert "in _unlucky" in found["1"].details
    assert [found[str(k)].result for k in range(2, 5)] == [4, 9, 16]


@pytest.mark.parametrize(
    ("fault", "said"),
    [("die", "died (out of memory?), 2 times"), ("freeze", "took longer than 1 s, 2 times"), ("memory", "ran out of")],
)
def test_a_lost_process_costs_a_retry_then_a_line_and_nothing_else(fault: str, said: str, tmp_path: Path) -> None:
    times = {3: 1, 5: 9}  # the third call loses one process, the fifth each that it is given
    calls = [Call(key=str(k), function=_unlucky, arguments=(k, tmp_path, fault, times.get(k, 0))) for k in range(10)]
    with LocalProcesses(3, limit_s=1.0) as engine:
        found = {done.call.key: done for done in engine.run(calls)}
    assert said in found["5"].lost
    assert found["5"].result is None
    assert {key: done.result for key, done in found.items() if key != "5"} == {
        str(k): k**2 for k in range(10) if k != 5
    }
    assert len(list(tmp_path.glob("3-*"))) == 1
    assert len(list(tmp_path.glob("5-*"))) == 2
