"""A room whose jobs are planned with a stand-in for ``fipt``, and the jobs of its first run."""

import copy

SETUP = {"evening": {"emitters": [{"scale": 0.0}], "environment": {"file": "night.exr"}}}
CONFIG = {
    "scenes": {
        "room": {
            "source": "procedural",
            "setups": SETUP,
            "settings": {"synthesize": {"train_views": 3, "val_views": 2}},
        }
    },
    "rounds": 1,
    "views_per_shard": 2,
}
"""Two train shards, one val shard, two rounds; a setup with an environment map."""

FIRST = {
    "synthesize_room": 1,
    "synthesize_views": 3,
    "synthesize_relit": 1,
    "check_poses": 1,
    "samples": 3,
    "environment": 1,
    "cache": 1,
    "bake": 2,
    "fit": 2,
    "emitters": 2,
    "refine": 2,
    "review": 1,
    "material_maps": 3,
    "render_views": 1,
    "relight_views": 1,
    "olat_views": 1,
    "scene_metrics": 1,
    "findings": 1,
    "scene_report": 1,
}


def changed(**keys):
    return {**copy.deepcopy(CONFIG), **keys}


def only(*rules):
    return {rule: FIRST[rule] for rule in rules}


SHOWN = (
    "review",
    "material_maps",
    "render_views",
    "relight_views",
    "olat_views",
    "scene_metrics",
    "findings",
    "scene_report",
)
