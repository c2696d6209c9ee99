"""Numbers of the frames against those of earlier versions (tests/report/golden).

The frames may have more rows, such as those of runs that were shipped later.
"""

import pandas as pd
import pytest

from tests.report.golden import cases


@pytest.fixture(scope="module", params=[*cases.CASES])
def case(request, tmp_path_factory):
    return request.param, cases.frames(request.param, tmp_path_factory.mktemp(request.param))


@pytest.mark.parametrize("name", cases.KEYS)
def test_numbers_are_as_before(case, name):
    called, frames = case
    file = cases.GOLDEN / f"{called}-{name}.csv"
    now = cases.numbers(getattr(frames, name), name)
    if not file.exists():
        assert now.empty
        return
    keys = [*cases.KEYS[name], "place"]
    before = pd.read_csv(file, dtype={"settings": str}).fillna({"settings": ""})
    both = before[keys].merge(now, on=keys, how="left", validate="1:1")[before.columns]
    pd.testing.assert_frame_equal(both, before, check_dtype=False, rtol=1e-6, atol=1e-6)
