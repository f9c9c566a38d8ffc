"""The process pool: results, messages, errors, dying processes and cancellation."""

from __future__ import annotations

import asyncio
import os
import time

import pytest

from pinholify.errors import BoardError
from pinholify.io.threads import VARIABLES
from pinholify.web.process_pool import ProcessPool, WorkerError


def count(report, number):
    for i in range(number):
        report(i)
    return number


def refuse():
    raise BoardError("a sentence for people")


def fail():
    raise ZeroDivisionError


def die():
    os._exit(1)


def sleep(report):
    report(os.getpid())
    time.sleep(600)


async def trial(pool):
    messages = []
    assert await pool.run(count, 3, on_message=messages.append) == 3
    assert messages == [0, 1, 2]
    with pytest.raises(BoardError, match="a sentence for people"):
        await pool.run(refuse)
    with pytest.raises(WorkerError, match="an internal error occurred"):
        await pool.run(fail)
    with pytest.raises(WorkerError, match="ended before the work was done"):
        await pool.run(die)
    assert await pool.run(count, 1, on_message=messages.append) == 1
    await cancelled(pool)
    assert await pool.run(pow, 2, 3) == 8


async def cancelled(pool):
    started = asyncio.get_running_loop().create_future()
    task = asyncio.create_task(pool.run(sleep, on_message=started.set_result))
    process = await asyncio.wait_for(started, 60)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)


def test_work_reports_messages_and_ends_in_every_way():
    async def whole():
        pool = ProcessPool(1)
        try:
            await trial(pool)
        finally:
            pool.close()

    asyncio.run(whole())


def threads():
    return [os.environ.get(variable) for variable in VARIABLES]


def test_linear_algebra_takes_one_thread_of_a_process(monkeypatch):
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)

    async def asked():
        pool = ProcessPool(1)
        try:
            return await pool.run(threads)
        finally:
            pool.close()

    assert set(asyncio.run(asked())) == {"1"}
