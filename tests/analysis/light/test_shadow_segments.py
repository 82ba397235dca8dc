"""The plane of least total variation against known answers."""

import numpy as np

from texloom.stages.analysis.light.shadow_segments import least_total_variation


def test_noise_does_not_tear_a_disc(rng: np.random.Generator) -> None:
    disc = np.hypot(*(np.indices((64, 64)) - 31.5)) < 20
    cost = (np.where(disc, -1, 1) + rng.normal(0, 2, disc.shape)).astype(np.float32)
    assert ((cost < 0) != disc).mean() > 0.25
    part = least_total_variation(cost, np.float32(3), (cost < 0).astype(np.float32), 150)
    assert ((part > 0.5) != disc).mean() < 0.03


def test_a_part_is_kept_where_its_area_tells_more_than_its_border_costs() -> None:
    cost = np.ones((40, 40), np.float32)
    cost[10:22, 10:22] = -1  # 144 px against a border of about 48 px
    start = np.zeros_like(cost)
    kept, gone = (least_total_variation(cost, np.float32(smooth), start, 400) for smooth in (1, 5))
    assert kept[12:20, 12:20].min() > 0.9
    assert gone.max() < 0.1
