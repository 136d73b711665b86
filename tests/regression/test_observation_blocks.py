"""Real files read block after block: the same observations as read at once."""

from dataclasses import fields

import numpy as np
import pytest

from truenorth.formats import iter_observations, read_observations
from truenorth.formats.blocks import join_observations

FILES = (
    "moving_simulator_rose/Rover-dynamic_MO_Spirent.obs.gz",
    "pair_38m_gps/UPC10770.11o.gz",
    "pair_0.33m_ublox/rover.obs.gz",
    "pair_0.33m_ublox/base.ubx.gz",
    "rinex_samples/npaz3550.21o",
    "rinex_samples/delf0010.21d",
    "rinex_samples/KMS300DNK_R_20221591000_01H_30S_MO.crx",
)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("block_epochs", [50, 3600])
def test_blocks_are_the_whole(data_dir, name, block_epochs):
    whole = read_observations(data_dir / name)
    blocks = list(iter_observations(data_dir / name, block_epochs=block_epochs))
    assert [block.n_epochs for block in blocks[:-1]] == [block_epochs] * (len(blocks) - 1)
    assert all(block.meta == whole.meta for block in blocks)
    joined = join_observations(blocks)
    for field in fields(whole):
        here, there = getattr(joined, field.name), getattr(whole, field.name)
        if isinstance(there, np.ndarray):
            assert here.dtype == there.dtype
            np.testing.assert_array_equal(here, there)
        else:
            assert here == there
