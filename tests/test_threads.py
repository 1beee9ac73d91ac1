"""Tasks on threads: order, nesting, and their end after an exception."""

from __future__ import annotations

import threading
import time
from concurrent.futures import CancelledError

import pytest

from bowstring import threads


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 2)


def work_until_ended(item: int, ended: list[int]) -> None:
    """Ten seconds of work that checks whether it is ended, and then notes the item."""
    try:
        for _ in range(2000):
            time.sleep(0.005)
            threads.check()
    except CancelledError:
        ended.append(item)
        raise


def test_results_keep_the_order_and_are_counted() -> None:
    seen: list[int] = []

    def slow_first(item: int) -> int:
        time.sleep(0.05 if item == 0 else 0.0)
        return 10 * item

    assert threads.results(slow_first, range(5), seen.append) == [0, 10, 20, 30, 40]
    assert seen == [1, 2, 3, 4, 5]
    assert threads.results(slow_first, []) == []


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 100])
def test_parts_keep_the_order(count: int) -> None:
    assert threads.in_parts(lambda item: item**2, range(count)) == [k**2 for k in range(count)]


def test_tasks_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 6)
    assert threads.results(lambda _: threads.free_cores(), range(2)) == [3, 3]
    assert threads.results(lambda _: threads.free_cores(), range(9)) == [1] * 9
    assert threads.results(lambda _: threads.free_cores(), range(4), most=3) == [2] * 4
    assert threads.results(lambda _: threads.free_cores(), range(4), most=1) == [6] * 4


def test_an_exception_ends_the_tasks_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: 4)
    ended: list[int] = []

    def outer(item: int) -> None:
        if item == 0:
            time.sleep(0.1)
            raise ValueError
        threads.results(lambda part: work_until_ended(part, ended), range(2))

    with pytest.raises(ValueError):
        threads.results(outer, range(2))
    assert sorted(ended) == [0, 1]


def test_tasks_of_a_task_run_on_its_thread() -> None:
    def outer(item: int) -> set[int]:
        assert threads.free_cores() == 1
        own = threading.get_ident()
        inner = threads.results(lambda _: threading.get_ident(), range(3))
        return {own, *inner, *threads.in_parts(lambda _: threading.get_ident(), range(40))}

    assert all(len(each) == 1 for each in threads.results(outer, range(4)))
    assert threads.free_cores() == 2
    threads.check()  # does nothing outside of a task


@pytest.mark.parametrize("from_notify", [False, True])
def test_an_exception_ends_the_others(from_notify: bool) -> None:
    ended, begun = list[int](), list[int]()

    def task(item: int) -> int:
        begun.append(item)
        if item == 0:
            time.sleep(0.05)
            if not from_notify:
                raise KeyboardInterrupt
            return 0
        work_until_ended(item, ended)
        return item

    def stop(done: int) -> None:
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        threads.results(task, range(40), stop)
    assert time.monotonic() - start < 5.0
    assert sorted(ended) == sorted(set(begun) - {0}) and len(begun) < 40
