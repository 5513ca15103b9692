"""Light from outside: what the training pictures say about rays that leave the mesh.

INPUTS:  results/{scene}/hits/{shard}.manifest.json of the training shards, their pictures
         an environment map, where the config names one
OUTPUTS: results/{scene}/background.npz    map over all directions; one zero where nothing is seen outside
"""


rule background:
    """Find what light comes from outside the mesh."""
    input:
        images=images("train"),
        hits=sharded("results/{scene}/hits/{shard}.manifest.json", "train"),
        file=background_file,
    output:
        background="results/{scene}/background.npz",
        stats="results/{scene}/stats/background.json",
    log:
        "results/{scene}/logs/background.log",
    benchmark:
        "results/{scene}/benchmarks/background.jsonl"
    resources:
        mem_mb=4000,
    params:
        dataset=folder("results/{scene}/dataset"),
        hits=folders_of("hits"),
        settings=settings("background"),
        version=VERSIONS["background"],
    shell:
        "fipt background --dataset {params.dataset:q} --hits {params.hits:q} --out {output.background:q}"
        " --settings {params.settings:q} --stats {output.stats:q} > {log:q} 2>&1"
