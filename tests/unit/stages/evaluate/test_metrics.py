"""Figures on cases small enough to compute by hand."""

import numpy as np
import pytest

from fipt.errors import FiptError
from fipt.stages.evaluate.emission import emitted_ratios, emitting_triangles, triangle_figures
from fipt.stages.evaluate.metrics import (
    MaterialFigures,
    RenderExposure,
    finite,
    image_psnr,
    psnr,
    published_mean,
    published_view,
)


def layers(size=(1, 4), **changes):
    """Grey maps of ``size``: kd 0.5, a' 0.5, roughness 0.6, not metallic, nothing emits."""
    grey = np.full((*size, 3), 0.5, np.float32)
    maps = {
        "kd": grey,
        "reflectance": grey,
        "base_color": grey,
        "roughness": np.full(size, 0.6, np.float32),
        "metallic": np.zeros(size, np.float32),
        "emission": np.zeros((*size, 3), np.float32),
        "emission_mask": np.zeros(size, np.float32),
        "hit": np.ones(size, np.float32),
    }
    return {**maps, **{name: np.asarray(value, np.float32) for name, value in changes.items()}}


def emission(*radiance):
    """Emission layers of a one-row view: radiance per pixel, the same in R, G and B."""
    values = np.array([radiance], np.float32)
    return {
        "emission": np.repeat(values[..., None], 3, axis=2),
        "emission_mask": (values > 0).astype(np.float32),
    }


def figures(*pairs):
    gathered = MaterialFigures()
    for estimate, truth in pairs:
        gathered.add(estimate, truth)
    return gathered.figures()


def test_psnr_of_known_errors():
    assert psnr(0.01) == pytest.approx(20.0)
    assert psnr(0.0) == pytest.approx(100.0)
    assert psnr(None) is None


def test_material_figures_leave_out_emitters_and_misses():
    truth = layers(**emission(0, 0, 5, 0))
    estimate = layers(
        kd=[[[0.6] * 3, [0.5] * 3, [0.0] * 3, [0.0] * 3]],
        roughness=[[0.8, 0.6, 0.0, 0.0]],
        metallic=[[0.0, 0.5, 1.0, 1.0]],
        hit=[[1, 1, 1, 0]],
        **emission(0, 0, 5, 0),
    )
    result = figures((estimate, truth))
    assert result["kd_psnr"] == pytest.approx(-10 * np.log10(0.01 / 2), rel=1e-5)
    assert result["reflectance_psnr"] == pytest.approx(100.0)
    assert result["roughness_l1"] == pytest.approx(0.1, rel=1e-5)
    assert result["metallic_l1"] == pytest.approx(0.25)
    assert result["pixels"] == {"materials": 2, "emission_union": 1}


def test_surface_where_the_room_has_none_is_not_judged():
    shown = np.array([[1, 1, 0, 0]])
    truth = {name: values * (shown if values.ndim == 2 else shown[..., None]) for name, values in layers().items()}
    result = figures((layers(kd=[[[0.6] * 3, [0.5] * 3, [0.9] * 3, [0.9] * 3]], **emission(0, 0, 0, 7)), truth))
    assert result["kd_psnr"] == pytest.approx(-10 * np.log10(0.01 / 2), rel=1e-5)
    assert result["emission_iou"] is None, "a pane that closes an open window is no false emitter"
    assert result["pixels"]["materials"] == 2


def test_errors_by_confidence():
    """Two sure pixels without error, two unsure ones with; a lamp and a miss count nowhere."""
    truth = layers((1, 6), **emission(0, 0, 0, 0, 5, 0))
    estimate = layers(
        (1, 6),
        kd=[[[0.5] * 3, [0.5] * 3, [0.6] * 3, [0.8] * 3, [0.0] * 3, [0.0] * 3]],
        roughness=[[0.6, 0.6, 0.7, 0.9, 0.0, 0.0]],
        confidence=[[1.0, 0.9, 0.1, 0.0, 0.1, 0.1]],
        hit=[[1, 1, 1, 1, 1, 0]],
        **emission(0, 0, 0, 0, 5, 0),
    )
    classes = figures((estimate, truth), (estimate, truth))["by_confidence"]
    assert [(c["from"], c["to"], c["share"]) for c in classes] == [
        (0.0, 0.2, 0.5),
        (0.2, 0.4, 0),
        (0.4, 0.6, 0),
        (0.6, 0.8, 0),
        (0.8, 1.0, 0.5),
    ]
    assert classes[0]["kd_psnr"] == pytest.approx(-10 * np.log10((0.1**2 + 0.3**2) / 2), rel=1e-5)
    assert classes[0]["roughness_l1"] == pytest.approx(0.2, rel=1e-5)
    assert classes[4]["kd_psnr"] == pytest.approx(100)
    assert classes[2] == {"from": 0.4, "to": 0.6, "share": 0.0} | dict.fromkeys(
        ("kd_psnr", "reflectance_psnr", "roughness_l1", "metallic_l1")
    )
    assert figures((layers(), layers()))["by_confidence"] is None  # maps of another program
    assert figures((layers(), layers()))["calibration"] is None


def test_predicted_errors_stand_beside_those_found():
    """Two classes whose errors of kd are predicted well and four times too large; roughness is predicted exactly."""
    truth = layers((1, 4), **emission(0, 0, 0, 0))
    estimate = layers(
        (1, 4),
        kd=[[[0.52] * 3, [0.48] * 3, [0.6] * 3, [0.4] * 3]],
        roughness=[[0.7, 0.7, 0.6, 0.6]],
        confidence=[[1.0, 0.9, 0.1, 0.1]],
        kd_error=[[0.025, 0.025, 0.4, 0.4]],
        roughness_error=[[0.1, 0.1, 0.0, 0.0]],
        metallic_error=[[0.3, 0.3, 0.0, 0.0]],
        hit=[[1, 1, 1, 1]],
        **emission(0, 0, 0, 0),
    )
    found = figures((estimate, truth))
    low, high = found["by_confidence"][0], found["by_confidence"][4]
    assert high["predicted_kd_psnr"] == pytest.approx(-20 * np.log10(0.025), rel=1e-5)
    assert low["predicted_kd_psnr"] == pytest.approx(-20 * np.log10(0.4), rel=1e-5)
    assert high["predicted_roughness_l1"] == pytest.approx(0.1)
    assert found["calibration"] == {"ordered": True, "kd": 0.5, "roughness": 1.0, "metallic": 0.5}
    swapped = estimate | {"confidence": 1 - estimate["confidence"]}
    assert not figures((swapped, truth))["calibration"]["ordered"]


def test_squared_error_is_pooled_over_views_not_averaged_per_view():
    truth = layers((1, 1))
    bad, exact = layers((1, 1), kd=[[[0.7] * 3]]), layers((1, 1))
    result = figures((bad, truth), (exact, truth))
    assert result["kd_psnr"] == pytest.approx(-10 * np.log10(0.04 / 2), rel=1e-5)


def test_emission_iou_and_log_radiance():
    truth, estimate = layers(**emission(2, 2, 0, 0)), layers(**emission(2 * np.e, 0, 3, 0))
    result = figures((estimate, truth), (layers(**emission(0, 1, 0, 0)),) * 2)
    assert result["emission_iou"] == pytest.approx((1 + 1) / (3 + 1))
    assert result["log_radiance_error"] == pytest.approx(0.5, rel=1e-5)


def test_no_qualifying_pixel_gives_null_and_not_nan():
    shining = layers(**emission(1, 1, 1, 1))
    result = figures((shining, shining))
    assert result["emission_iou"] == 1.0
    for name in ("kd_psnr", "reflectance_psnr", "base_color_psnr", "roughness_l1", "metallic_l1"):
        assert result[name] is None
    assert result["published"]["kd_psnr"] is None
    assert result["published"]["reflectance_psnr"] is None
    assert result["published"]["emission_iou"] == 1.0


def test_without_emitters_emission_is_null():
    result = figures((layers(), layers()))
    assert result["emission_iou"] is None
    assert result["log_radiance_error"] is None
    assert result["published"]["log_l2"] is None


def test_no_truth_at_all_gives_only_null():
    result = figures()
    published = result.pop("published")
    assert result.pop("pixels") == {"materials": 0, "emission_union": 0}
    assert set(result.values()) == set(published.values()) == {None}


def test_truth_may_lack_layers():
    truth = layers(**emission(0, 1, 0, 0))
    for name in ("base_color", "metallic", "emission_mask"):
        del truth[name]
    result = figures((layers(**emission(0, 1, 0, 0)), truth))
    assert result["base_color_psnr"] is None
    assert result["metallic_l1"] is None
    assert result["kd_psnr"] == pytest.approx(100.0)
    assert result["emission_iou"] == 1.0


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_maps_are_refused(bad):
    with pytest.raises(FiptError, match=r"materials/a\.exr .* 1 of layer metallic"):
        finite(layers(metallic=[[0, bad, 0, 0]]), "materials/a.exr")


def test_published_kd_counts_only_true_roughness_one_over_the_whole_image():
    truth = layers(roughness=[[1, 1, 0.6, 1]], **emission(0, 0, 0, 1))
    estimate = layers(kd=[[[0.6] * 3, [0.5] * 3, [0.0] * 3, [0.0] * 3]], roughness=[[0.1, 1, 0.6, 1]])
    result = published_view(estimate, truth)
    difference = (np.floor(0.6 * 255) - np.floor(0.5 * 255)) / 255
    assert result["kd_psnr"] == pytest.approx(-10 * np.log10(difference**2 / 4), abs=1e-3)
    rough = 1 - np.floor(0.2 * 255) / 255
    assert result["roughness_psnr"] == pytest.approx(-10 * np.log10(rough**2 / 4), abs=0.05)
    assert result["emission_iou"] == 0.0
    assert result["log_l2"] == pytest.approx(np.log(2) ** 2 / 4)


def test_published_kd_needs_more_than_black():
    """Else an image whose only pixels of roughness 1 are black would have 100 dB, whatever was estimated elsewhere."""
    estimate = layers(kd=[[[0.0] * 3, *3 * [[0.9] * 3]]], roughness=[[1, 0.6, 0.6, 0.6]])
    black = layers(kd=[[[0.0] * 3, *3 * [[0.2] * 3]]], roughness=[[1, 0.6, 0.6, 0.6]])
    assert published_view(estimate, black)["kd_psnr"] is None
    grey = layers(kd=[4 * [[0.2] * 3]], roughness=[[1, 0.6, 0.6, 0.6]])
    assert published_view(estimate, grey)["kd_psnr"] is not None


def test_published_mean_is_over_the_views_that_have_the_figure():
    names = ("kd_psnr", "reflectance_psnr", "roughness_psnr", "emission_iou", "log_l2")
    one, two = dict.fromkeys(names, 10.0), dict.fromkeys(names, 20.0)
    two["kd_psnr"] = None
    result = published_mean([one, two])
    assert result["kd_psnr"] == 10.0
    assert result["log_l2"] == 15.0


def test_picture_psnr_clips_and_skips_invalid_pixels():
    photo = np.array([[[5.0] * 3, [0.2] * 3]], np.float32)
    render = np.array([[[1.0] * 3, [np.float32(9)] * 3]], np.float32)
    assert image_psnr(render, photo, np.array([[1.0, 0.0]])) == pytest.approx(100.0)
    assert image_psnr(render, photo, np.zeros((1, 2))) is None
    black, white = np.zeros((1, 1, 3)), np.ones((1, 1, 3))
    assert image_psnr(black, white) == pytest.approx(0.0)


def test_exposure_is_found_from_unclipped_pixels():
    photo = np.array([[[0.2] * 3, [0.6] * 3, [50.0] * 3]])
    exposure = RenderExposure()
    exposure.add(photo / 2, photo, np.ones((1, 3)))
    assert exposure.scale == pytest.approx(2.0)
    assert image_psnr(photo / 2, photo, scale=exposure.scale) == pytest.approx(100.0)
    assert RenderExposure().scale == 1.0


def test_triangles_emit_by_majority_of_the_pixels_that_see_them():
    ids = np.array([0, 0, 0, 1, 1, 2])
    shining = np.array([True, True, False, True, False, False])
    emitting, seen, judged = emitting_triangles(4, [(ids, shining), (np.array([0, 0, 3]), None)])
    assert emitting.tolist() == [True, False, False, False]
    assert seen.tolist() == [True] * 4
    assert judged.tolist() == [True, True, True, False]


def test_false_missed_and_unseen_triangles():
    truth = np.array([True, True, True, False])
    seen = np.array([True, True, False, True])
    result = triangle_figures(np.array([0, 3]), truth, np.array([1.0, 2.0, 4.0, 8.0]), seen)
    assert [result[f"{name}_triangles"] for name in ("found", "true", "false", "missed")] == [
        2,
        3,
        1,
        1,
    ]
    assert result["false_area"] == 8.0
    assert result["missed_area"] == 2.0
    assert result["unseen_triangles"] == 1
    unknown = triangle_figures(np.array([], int), None, np.ones(4))
    assert unknown["found_triangles"] == 0
    assert unknown["false_triangles"] is None


def test_area_and_flux_do_not_depend_on_triangles():
    """Of two pixels that emit in truth one is found, twice as bright; a third is false."""
    grey = np.ones((1, 3))
    area, true, found = np.array([1.0, 3.0, 2.0]), np.array([[4], [4], [0]]) * grey, np.array([[0], [8], [1]]) * grey
    result = emitted_ratios([(area, true, found), (area, 0 * true, 0 * found)])
    assert result == {"emitted_area": pytest.approx(5 / 4), "emitted_flux": pytest.approx(26 / 16)}
    assert emitted_ratios([(area, 0 * true, found)]) == {"emitted_area": None, "emitted_flux": None}
