"""What the verbs of images are told: rays of a pixel, views, photographs for the exposure."""

from pathlib import Path

import pytest

from fipt.errors import FiptError
from fipt.stages.render.relight_stage import RelightInputs, run
from fipt.stages.render.render_stage import RenderInputs
from fipt.stages.render.settings import RelightSettings, VideoSettings
from fipt.stages.render.video_stage import VideoInputs
from fipt.stages.render.video_stage import run as run_video
from fipt.stages.report.settings import ReportSettings
from fipt.stages.samples.settings import SamplesSettings
from tests import scenes

HERE = Path("none")
FILES = dict.fromkeys(("dataset", "cache", "model", "emitters", "out", "manifest"), HERE)


def test_what_is_left_out_is_as_in_the_sections_samples_and_report():
    assert RenderInputs(**FILES, views=("c",)).rays_per_side == SamplesSettings().grid
    video = VideoInputs(dataset=HERE, cameras="{}", images=HERE, manifest=HERE)
    assert video.max_views == ReportSettings().max_views


def test_a_pixel_needs_a_ray():
    with pytest.raises(FiptError, match="--rays-per-side must be 1 to 64; it is 0"):
        RenderInputs(**FILES, views=("c",), rays_per_side=0)


def test_a_setup_without_cameras_needs_views(tmp_path):
    inputs = RelightInputs(**FILES | {"dataset": scenes.write_dataset(tmp_path)}, setup="{}")
    with pytest.raises(FiptError, match="there are no views to relight; give --views"):
        run(inputs, RelightSettings())


def test_an_exposure_needs_a_photograph():
    video = VideoInputs(dataset=HERE, cameras="{}", images=HERE, manifest=HERE, max_views=0)
    with pytest.raises(FiptError, match="--max-views must be at least 1; it is 0"):
        run_video(video, VideoSettings())
