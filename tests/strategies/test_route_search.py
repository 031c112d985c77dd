"""Which poses may follow which, against one by one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from strategies.path_planning.route_search import find_all_close_poses, find_close_spots

NEAR_M, BEHIND_M = 24.0, 4.0


@given(st.integers(0, 150), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 4.0, 12.0]))
def test_poses_lead_to_those_close_by_in_their_order(count: int, seed: int, lattice_m: float) -> None:
    poses = np.random.default_rng(seed).uniform((0.0, 0.0, -3.2), (120.0, 60.0, 3.2), (count, 3))
    if lattice_m:  # many lie exactly as far from each other as counts
        poses[:, :2] = lattice_m * np.round(poses[:, :2] / lattice_m)
    indptr, after = find_all_close_poses(poses, NEAR_M, BEHIND_M)
    found, out = np.split(after, indptr[1:-1]) if count else [], np.empty(count, np.int64)
    for pose, others in zip(poses, found, strict=True):
        assert others.tolist() == out[: find_close_spots(pose, poses, NEAR_M, BEHIND_M, out)].tolist()
    assert len(indptr) == count + 1 and indptr[-1] == len(after)
