"""What is left out of compiling: work that nobody needs, and nothing else."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numba.core.errors import NumbaError, TypingError

from tsplat._compiler import with_room
from tsplat._jit import JIT, kernel, part

compiled_only = pytest.mark.skipif(not JIT, reason="needs compiled kernels")


@part
def twice(x):  # type: ignore[no-untyped-def]
    return x + x


@part
def first_twice(values):  # type: ignore[no-untyped-def]
    return twice(values[0]) + twice(1)


def test_kernels_share_a_part_and_call_it_with_several_types() -> None:
    one, other = kernel(lambda x: twice(x) + 1), kernel(lambda values: first_twice(values) + twice(values[1]))
    assert one(3) == 7
    assert one(1.25) == 3.5
    assert other(np.array([2.0, 0.5])) == 7.0
    assert other(np.array([2, 5])) == 16


@pytest.fixture
def collecting() -> Iterator[None]:
    yield
    gc.enable()


@compiled_only
@pytest.mark.parametrize("before", [True, False])
@pytest.mark.usefixtures("collecting")
def test_garbage_is_collected_after_compiling_just_if_it_was_before(before: bool) -> None:
    (gc.enable if before else gc.disable)()
    assert kernel(lambda x: x + 1)(1) == 2
    assert gc.isenabled() is before
    with pytest.raises(TypingError):
        kernel(lambda x: x.nothing)(1)
    assert gc.isenabled() is before


@compiled_only
@pytest.mark.parametrize(
    "wrong",
    [lambda values: values.reshape(-1)[0], lambda values: np.zeros(len(values))[0], lambda values: len([values])],
)
def test_what_would_need_numba_when_it_runs_is_no_kernel(wrong: Callable[..., Any]) -> None:
    with pytest.raises((TypeError, NumbaError)):
        kernel(wrong)(np.zeros((2, 3))[:, ::2])


@compiled_only
def test_a_kernel_returns_a_number_or_nothing() -> None:
    assert kernel(lambda x: x > 2)(3) is True
    assert kernel(lambda _: None)(3) is None
    with pytest.raises(TypeError, match="returns a number, or nothing"):
        kernel(lambda x: (x, x))(3)


def test_deep_calls_with_room_map_no_memory() -> None:
    resource = pytest.importorskip("resource")

    def leaf() -> None:
        pass

    def dive(depth: int) -> None:
        for _ in range(500):
            leaf()
        if depth:
            dive(depth - 1)

    def pages_mapped() -> int:
        return int(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)

    roomy = with_room(dive)
    roomy(300)
    before = pages_mapped()
    roomy(300)
    assert pages_mapped() - before < 100


def test_with_room_a_function_returns_and_raises_as_before() -> None:
    assert with_room(divmod)(7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        with_room(divmod)(7, 0)
