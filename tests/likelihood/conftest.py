"""One BLAS thread: dense references are small, and two pools of threads on busy cores cost a factor of ten."""

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield
