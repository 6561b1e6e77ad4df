import numpy as np
import pytest

from sed2cad.evaluation.metrics import Detection, match_patches, modes

TYPES = np.repeat([0, 1, 2], [60, 20, 20])
TRUE = np.repeat([0, 1, 2], [60, 20, 20])


def test_permuted_labels_are_perfect():
    """Names of patches do not matter, nor the order of the points."""
    order = np.random.default_rng(0).permutation(100)
    matching = match_patches(np.array([7, 3, 9])[TRUE][order], TRUE[order], TYPES[order], TYPES[order])
    assert matching.p_miou == matching.p_miou_strict == matching.p_miou_large == matching.t_miou == 1
    assert matching.size.tolist() == [60, 20, 20]


def test_merged_patches():
    """A (60) and C (20) found as one: IoU 60/80; C has no match, which only the strict mean counts."""
    found = np.where(TRUE == 1, 1, 0)
    matching = match_patches(found, TRUE, TYPES, TYPES)
    assert matching.p_miou == pytest.approx((0.75 + 1) / 2)
    assert matching.p_miou_strict == pytest.approx((0.75 + 1) / 3)
    assert matching.t_miou == 1


def test_split_patch():
    """A found as 45 and 15 points: the larger piece is its match, the other hurts nobody."""
    found = TRUE.copy()
    found[:15] = 3
    matching = match_patches(found, TRUE, TYPES, TYPES)
    assert matching.p_miou == matching.p_miou_strict == pytest.approx((0.75 + 1 + 1) / 3)


def test_points_without_label_belong_to_no_patch():
    """30 points of A and all of C without label: IoU 1/2, 1 and none; they form no patch of their own."""
    found = TRUE.copy()
    found[:30] = -1
    found[80:] = -1
    matching = match_patches(found, TRUE, TYPES, TYPES)
    assert matching.iou.tolist() == [0.5, 1, 0]
    assert matching.p_miou == 0.75
    assert matching.p_miou_strict == 0.5


def test_nothing_found():
    matching = match_patches(np.full(100, -1), TRUE, np.full(100, -1), TYPES)
    assert matching.p_miou_strict == 0
    assert np.isnan([matching.p_miou, matching.t_miou]).all()


def test_large_patches_are_measured_in_points_of_ten_thousand():
    """Of 1,000 points 3 are large enough, 2 are not."""
    true = np.repeat([0, 1, 2], [995, 3, 2])
    found = np.where(true == 2, 1, true)
    matching = match_patches(found, true, None, np.zeros(1_000, int))
    assert matching.large.tolist() == [True, True, False]
    assert matching.p_miou_large == pytest.approx((1 + 3 / 5) / 2)


def test_t_miou_takes_the_mode_of_the_points():
    """A has 25 of 60 points wrong, which is outvoted; B has 11 of 20 wrong, which is not."""
    types = TYPES.copy()
    types[:25] = 5
    types[60:71] = 5
    assert match_patches(TRUE, TRUE, types, TYPES).t_miou == pytest.approx(2 / 3)


def test_modes_leave_out_points_without_type_or_patch():
    modes_ = modes(np.array([0, 0, 0, 1, -1]), np.array([2, -1, -1, -1, 3]), 2)
    assert modes_.tolist() == [2, -1]


def test_detection_adds_up():
    found, true = np.array([1, 1, 0, 0], bool), np.array([1, 0, 1, 1], bool)
    both = Detection.of(found, true) + Detection.of(true, true)
    assert both == Detection(4, 5, 6)
    assert (both.precision, both.recall, both.f1) == (4 / 5, 4 / 6, pytest.approx(8 / 11))
    assert Detection(0, 0, 0).f1 == 0
