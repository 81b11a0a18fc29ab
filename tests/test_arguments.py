"""What kernels are given: arrays of any kind, numbers, tuples of them, and nothing else."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
import pytest

from tsplat._arguments import described, flat, flat_job, known, packing
from tsplat._jit import JIT, Kernel, kernel

compiled_only = pytest.mark.skipif(not JIT, reason="needs compiled kernels")


class Job(NamedTuple):
    values: np.ndarray
    weight: float
    nothing: None
    whole: int
    pair: tuple[bool, np.float32]


@kernel
def _total(job):  # type: ignore[no-untyped-def]
    total = 0.0
    for row in range(job.values.shape[0]):
        for column in range(job.values.shape[1]):
            total += (10.0 * row + column) * job.values[row, column]
    return job.weight * total + job.whole + (100.0 if job.pair[0] else 0.0) + job.pair[1]


@kernel
def _double(values):  # type: ignore[no-untyped-def]
    for i in range(len(values)):
        values[i] *= 2


@kernel
def _nothing(values, more):  # type: ignore[no-untyped-def]
    return more is None


def slow_total(job: Job) -> float:
    places = 10 * np.arange(job.values.shape[0])[:, None] + np.arange(job.values.shape[1])
    return float(job.weight * (places * job.values).sum() + job.whole + 100 * job.pair[0] + job.pair[1])


@pytest.mark.parametrize("dtype", ["u1", "i4", "f4", "f8"])
def test_arrays_numbers_and_tuples_arrive_as_they_are_in_any_layout(dtype: str) -> None:
    values = np.arange(60).reshape(6, 10).astype(dtype)
    layouts = [values, values[::2], values[:, ::3], values.T, values[:0], values[2:3]]
    for layout in layouts:
        job = Job(layout, 0.5, None, -(2**40), (True, np.float32(0.25)))
        assert _total(job) == slow_total(job)


def test_a_kernel_changes_the_array_it_is_given_and_not_a_copy() -> None:
    values = np.arange(5, dtype=np.int32)
    _double(values)
    _double(values[::2])
    assert values.tolist() == [0, 2, 8, 6, 16]


def test_none_is_another_type_than_an_array() -> None:
    values = np.zeros(3, np.float32)
    assert _nothing(values, None) is True
    assert _nothing(values, values) is False


@compiled_only
def test_an_array_that_cannot_be_written_needs_no_code_of_its_own() -> None:
    values = np.ones((2, 3))
    job = Job(values, 1.0, None, 0, (False, np.float32(0)))
    before = _total(job)
    values.flags.writeable = False
    compiled = len(_total.codes)
    assert _total(job) == before
    assert len(_total.codes) == compiled


@compiled_only
@pytest.mark.parametrize("wrong", ["text", {}, [1, 2], 1j, np.zeros(3, "i4,f4")[0], object()])
def test_what_no_kernel_takes_is_named(wrong: Any) -> None:
    with pytest.raises(TypeError, match=re.escape(f"got {type(wrong).__qualname__}")):
        _double(wrong)


@compiled_only
def test_an_array_that_is_not_aligned_is_refused() -> None:
    values = np.zeros(17, np.uint8)[1:].view(np.float32)
    with pytest.raises(TypeError, match="aligned"):
        _double(values)


def test_types_are_told_apart_by_all_that_machine_code_depends_on() -> None:
    values = np.zeros((4, 4), np.float32)
    arrays = [values, values.astype(">f4"), values.astype(np.int32), values[:, ::2], values[0]]
    names = [described(flat((each,)).types) for each in [*arrays, 1, 1.0, True, None, (values,)]]
    assert len({*names}) == len(names)


def test_arguments_take_eight_bytes_each() -> None:
    types, values = flat((1, 2.0, np.float32(3.0), None, True, (np.zeros(2), np.uint64(2**64 - 1))))
    assert len(packing(types).pack(*values)) == 8 * 6


@pytest.mark.parametrize("fields", [0, 1, 3, 4])
def test_a_job_of_which_some_is_known_is_the_same_job(fields: int) -> None:
    job = (1, np.zeros(2), (np.zeros((3, 2), np.int32), 2.0), None)
    assert flat_job(job, known(job[len(job) - fields :])) == flat((0, job))


@compiled_only
def test_a_job_lives_as_long_as_what_works_on_it() -> None:
    @kernel
    def first(worker, values):  # type: ignore[no-untyped-def]
        return values[worker]

    assert isinstance(first, Kernel)
    work = first.on(np.full(1 << 20, 7.0))
    np.full(1 << 20, 8.0)  # would take the memory of the first
    assert work(5) == 7.0
