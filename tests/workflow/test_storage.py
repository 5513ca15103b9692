"""Results in object storage, against a server of moto: rooms go on elsewhere, and the bytes are the same."""

import os
import shutil
from contextlib import chdir
from pathlib import Path

import boto3
import pytest
from moto.server import ThreadedMotoServer

from benchmarks.jobs import WORKFLOW, run_all
from fipt.bucket import Bucket
from tests.cluster.__main__ import hashes
from tests.fitted import kept_threads
from tests.workflow.conftest import Workspace

pytestmark = pytest.mark.slow

CONFIG = {
    "scenes": {"room": {"source": "procedural"}},
    "rounds": 0,
    "synthesize": {"train_views": 2, "val_views": 1, "width": 32, "height": 24, "spp": 4, "denoise": False},
    "samples": {"grid": 1},
    "cache": {"resolution": 32},
}
SAMPLES, CACHE = "results/room/samples/train-000.manifest.json", "results/room/cache.npz"
MESH = "results/room/dataset/mesh.ply"
REVIEW = "results/room/emitters_review.yaml"
DECIDED = "mesh_triangles: 0\nemitters: []\n"
STORE = "s3://rooms/lab"
PLUGINS = Path(__file__).with_name("plugins")
SNAKEFILE = """from fipt.cli.run import WORKFLOW


include: str(WORKFLOW / "Snakefile")
"""


@pytest.fixture(scope="module")
def server():
    """Address of a storage with an empty bucket."""
    started = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    started.start()
    host, port = started.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "key")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        client().create_bucket(Bucket="rooms")
        yield os.environ["AWS_ENDPOINT_URL"]
    started.stop()


def client():
    """What speaks to the storage."""
    return boto3.Session().client("s3", region_name="us-east-1")


@pytest.fixture(scope="module")
def machine(server, tmp_path_factory):
    """A function that makes an empty working directory with the configuration: another machine."""

    def make(name: str, **changed) -> Workspace:
        made = Workspace(tmp_path_factory.mktemp(name), {**CONFIG, **changed}, stand_in=False)
        made.environment["AWS_ENDPOINT_URL"] = server
        return made

    return make


@pytest.fixture(scope="module")
def begun(machine, backend):
    """The machine on which the room is begun: cameras, mesh and samples are stored."""
    first = machine("first")
    first.fipt_run(SAMPLES, "--store", STORE)
    return first


def alone(machine: Workspace, *options: str) -> Path:
    """Run Snakemake with jobs that share no disk; the folder that has those of the jobs."""
    (machine.root / "Snakefile").write_text(SNAKEFILE)
    folder = machine.root.parent / f"{machine.root.name}-jobs"
    folder.mkdir()
    environment = {**machine.environment, "ALONE": str(folder)}
    environment["PYTHONPATH"] += f"{os.pathsep}{PLUGINS}"
    profile = str(WORKFLOW / "profiles" / "storage")
    told = ["--workflow-profile", profile, "--executor", "alone", "--jobs", "1", "--seconds-between-status-checks", "1"]
    done = machine.run(
        "snakemake", [*told, "--default-storage-prefix", STORE, *options], machine.root, environment, True
    )
    logs = "".join(path.read_text() for path in folder.glob("*.log"))
    assert done.returncode == 0, done.stdout + logs
    return folder


def test_a_room_goes_on_where_jobs_share_no_disk(begun, machine):
    second = machine("second", scenes="rooms.tsv")
    (second.root / "rooms.tsv").write_text("name\tsource\nroom\tprocedural\n")
    jobs = alone(second, "--", CACHE)
    assert sorted(path.name.partition("-")[0] for path in jobs.iterdir() if path.is_dir()) == [
        "cache",
        "synthesize_views",
    ]
    assert not list(second.root.rglob("*.npy")), "the machine that plans fetches nothing"
    # its folder had nothing: what is there was fetched with the sources and with manifests, or written
    (folder,) = (path for path in jobs.iterdir() if path.is_dir() and path.name.startswith("cache-"))
    assert list(folder.glob("results/room/samples/train-000/*.npy"))
    assert list(folder.glob("results/room/dataset/images/*.exr"))

    assert "everything is up to date" in begun.fipt_run(CACHE, "--store", STORE)
    plain = machine("plain")
    with chdir(plain.root), kept_threads():
        assert run_all(plain.jobs(CACHE)) == 0
    stored = {path: value for path, value in hashes(begun.root).items() if not path.endswith("/.snakemake_timestamp")}
    assert stored == hashes(plain.root)
    for folder in (begun, second):
        shutil.rmtree(folder.root / "results")


def test_another_machine_knows_what_was_made_with_which_settings(begun, machine):
    other = machine("other")
    assert "everything is up to date" in other.fipt_run(SAMPLES, "--store", STORE, "--dry-run")
    other.configure({**CONFIG, "samples": {"grid": 2}})
    said = other.fipt_run(SAMPLES, "--store", STORE, "--dry-run").splitlines()
    assert [line.partition(":")[0] for line in said] == ["[1/1] samples.train-000"]
    assert "Params have changed" in said[0]


def test_a_job_that_was_killed_while_it_stored_is_made_again(begun, machine, monkeypatch):
    client().delete_object(Bucket="rooms", Key=f"lab/{SAMPLES}")  # which is stored last
    other = machine("third")
    (other.root / MESH).parent.mkdir(parents=True)
    (other.root / MESH).write_text("a mesh that a run without a store has made since")
    said = other.fipt_run(SAMPLES, "--store", STORE)
    assert said.startswith("[1/1] samples.train-000\n")
    assert hashes(other.root)[SAMPLES.removeprefix("results/")]
    monkeypatch.chdir(other.root)
    bucket = Bucket(STORE)
    assert Path(MESH).read_bytes() == bucket.read(MESH)
    found = bucket.files("results/room")
    assert SAMPLES in found
    assert [path for path, stored in found.items() if not bucket.is_here(Path(path), stored)] == []
    # Snakemake sets the time of this file after the folder is stored: it would never be here as it was stored
    folder_time = SAMPLES.replace(".manifest.json", "/.snakemake_timestamp")
    assert Path(folder_time).is_file()
    assert folder_time not in found


def test_older_copies_do_not_count(begun, machine):
    other = machine("fourth")
    mesh = other.root / MESH
    mesh.parent.mkdir(parents=True)
    mesh.write_text("an older mesh")
    os.utime(mesh, (1, 1))
    other.fipt_run(SAMPLES, "--store", STORE)
    assert mesh.stat().st_size > 1000


def test_a_dry_run_stores_nothing(begun, machine):
    other = machine("dry", scenes="dry.tsv")
    (other.root / "dry.tsv").write_text("name\tsource\nroom\tprocedural\n")
    (other.root / REVIEW).parent.mkdir(parents=True)
    (other.root / REVIEW).write_text(DECIDED)
    other.fipt_run(SAMPLES, "--store", STORE, "--dry-run")
    bucket = Bucket(STORE)
    assert bucket.stored("dry.tsv") is bucket.stored(REVIEW) is None


def test_decisions_go_along(begun, machine):
    other = machine("fifth")
    (other.root / REVIEW).parent.mkdir(parents=True)
    (other.root / REVIEW).write_text(DECIDED)
    other.fipt_run(SAMPLES, "--store", STORE)
    another = machine("sixth")
    another.fipt_run(SAMPLES, "--store", STORE)
    assert (another.root / REVIEW).read_text() == DECIDED
    assert client().get_object(Bucket="rooms", Key=f"lab/{REVIEW}")["Body"].read() == DECIDED.encode()


@pytest.mark.parametrize(
    ("store", "changed", "said"),
    [
        ("rooms/lab", {}, "fipt: error: a store must be s3://BUCKET or s3://BUCKET/PREFIX; this is 'rooms/lab'; "),
        ("s3://nobodys", {}, "fipt: error: there is no bucket 'nobodys'; make it, or correct the URL"),
        (
            STORE,
            {"AWS_ENDPOINT_URL": "http://127.0.0.1:9"},
            f"fipt: error: {STORE} cannot be reached (",
        ),
        (STORE, {"AWS_PROFILE": "nobody"}, f"fipt: error: there are no credentials for {STORE} ("),
    ],
)
def test_a_store_that_cannot_be_used_is_one_line(machine, store, changed, said):
    here = machine("wrong")
    here.environment |= changed
    (line,) = here.fipt_run(SAMPLES, "--store", store, code=2).splitlines()
    assert line.startswith(said)
