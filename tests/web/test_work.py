"""Work in processes: its results, its errors, its death and its end."""

from __future__ import annotations

import asyncio
import os
import time

import pytest

from pinholify.errors import BoardError
from pinholify.io.threads import VARIABLES
from pinholify.web.work import Crew, WorkError


def count(say, number):
    for i in range(number):
        say(i)
    return number


def refuse(say):
    raise BoardError("a sentence for people")


def fail(say):
    raise ZeroDivisionError


def die(say):
    os._exit(1)


def sleep(say):
    say(os.getpid())
    time.sleep(600)


async def trial(crew):
    heard = []
    assert await crew.run(count, 3, heard=heard.append) == 3
    assert heard == [0, 1, 2]
    with pytest.raises(BoardError, match="a sentence for people"):
        await crew.run(refuse)
    with pytest.raises(WorkError, match="went wrong inside"):
        await crew.run(fail)
    with pytest.raises(WorkError, match="ended before it was done"):
        await crew.run(die)
    assert await crew.run(count, 1) == 1
    await cancelled(crew)
    assert await crew.run(count, 2) == 2


async def cancelled(crew):
    started = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(crew.run(sleep, heard=started.set_result))
    process = await asyncio.wait_for(started, 60)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_work_tells_how_far_it_is_and_ends_in_every_way():
    async def whole():
        crew = Crew(1)
        try:
            await trial(crew)
        finally:
            crew.close()

    asyncio.run(whole())


def threads(say):
    return [os.environ.get(variable) for variable in VARIABLES]


def test_linear_algebra_takes_one_thread_of_a_process(monkeypatch):
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)

    async def asked():
        crew = Crew(1)
        try:
            return await crew.run(threads)
        finally:
            crew.close()

    assert set(asyncio.run(asked())) == {"1"}
