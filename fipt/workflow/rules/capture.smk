"""The capture: photographs to calibrated, undistorted HDR views, and what is wrong with them.

INPUTS:  source: raw         a folder of RAW brackets (path), perhaps with calibration frames in calibration/KIND/
         source: procedural  results/{scene}/raw/, which rules/simulate.smk writes
OUTPUTS: results/{scene}/capture/calibration.json          what is known of the camera
         results/{scene}/capture/hdr.{shard}.manifest.json lists hdr/*.exr (linear RGB, valid.Y, flags.Y) and *.json
         results/{scene}/capture/qa.json                   figures and findings; which views are rejected
"""


rule calibrate:
    """Calibrate the camera of a capture."""
    input:
        ask("calibration_files"),
    output:
        calibration="results/{scene}/capture/calibration.json",
        stats="results/{scene}/stats/calibrate.json",
    log:
        "results/{scene}/logs/calibrate.log",
    benchmark:
        "results/{scene}/benchmarks/calibrate.jsonl"
    wildcard_constraints:
        scene=CONFIG.where("source.photographed"),
    resources:
        mem_mb=memory("calibrate"),
        runtime=minutes("calibrate"),
    params:
        capture=ask("source.photographs.folder"),
        settings=settings("capture"),
        version=VERSIONS["capture"],
    shell:
        "fipt calibrate --capture {params.capture:q} --out {output.calibration:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule develop:
    """Develop a shard of brackets into HDR views."""
    input:
        ask("brackets"),
        calibration="results/{scene}/capture/calibration.json",
    output:
        manifest="results/{scene}/capture/hdr.{shard}.manifest.json",
        stats="results/{scene}/stats/develop.{shard}.json",
    log:
        "results/{scene}/logs/develop.{shard}.log",
    benchmark:
        "results/{scene}/benchmarks/develop.{shard}.jsonl"
    resources:
        mem_mb=memory("develop"),
        runtime=minutes("develop"),
    params:
        capture=ask("source.photographs.folder"),
        views=ask("views.listed"),
        out=folder("results/{scene}/capture"),
        settings=settings("capture"),
        version=VERSIONS["capture"],
    shell:
        "fipt develop --capture {params.capture:q} --views {params.views:q}"
        " --calibration {input.calibration:q} --out {params.out:q} --keep-going"
        " --manifest {output.manifest:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"


rule qa:
    """Judge the developed views, and reject those that could not be developed."""
    input:
        ask("simulated_frames"),
        calibration="results/{scene}/capture/calibration.json",
        developed=sharded("results/{scene}/capture/hdr.{shard}.manifest.json", "all"),
    output:
        report="results/{scene}/capture/qa.json",
        stats="results/{scene}/stats/qa.json",
    log:
        "results/{scene}/logs/qa.log",
    benchmark:
        "results/{scene}/benchmarks/qa.jsonl"
    resources:
        mem_mb=memory("qa"),
        runtime=minutes("qa"),
    params:
        capture=ask("source.photographs.folder"),
        out=folder("results/{scene}/capture"),
        settings=settings("capture"),
        version=VERSIONS["capture"],
    shell:
        "fipt qa --capture {params.capture:q} --developed {params.out:q}"
        " --calibration {input.calibration:q} --out {output.report:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
