"""The runs of stages that a report lists."""

import json

from fipt.stages.report.runs import read_runs, stage_times


def test_stages_stand_in_the_order_of_the_pipeline(tmp_path):
    sections = {"first_mesh": "geometry", "mesh": "geometry", "check_views": "check_poses", "check-export": "export"}
    sections |= {"photograph": "synthesize", "truth": "synthesize", "develop": "capture", "qa": "capture"}
    rounds = "fit.round-1 fit.round-0 regroup.round-0 emitters.round-1 refine.round-1.train-000 bake.round-0.train-000"
    before = (
        "synthesize photograph develop qa import truth depth first_mesh check_views mesh check_poses cache environment"
    )
    after = "materials export check-export metrics findings of-another-program"
    for name in sorted(f"{rounds} {before} {after}".split()):
        stage = name.split(".")[0]
        content = {"stage": sections.get(stage, stage), "wall_s": 1.0}
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    labels = [time.label.replace(" · round ", " ") for time in stage_times(read_runs(tmp_path))]
    each_round = ["bake 0", "regroup 0", "fit 0", "refine 1", "emitters 1", "fit 1"]
    assert labels == before.split() + each_round + after.split()
