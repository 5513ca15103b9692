"""The whole chain of a scene in one process: the workflow's jobs, files and settings, in order.

`plan` lists the jobs; a test holds it against what the workflow's rules call. `run` calls them one
by one and skips what is up to date: a job is, when its command line (which holds the settings),
its stage's version and the content of its inputs and outputs are those of its record.
"""

from __future__ import annotations

import fcntl
import json
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from fipt.config.legacy import RESULTS, Scene
from fipt.errors import FiptError
from fipt.formats.files import existing_file, write_text
from fipt.formats.manifests import file_hash
from fipt.registry import VERSIONS
from fipt.scene.review import FILE as REVIEW_FILE


@dataclass(frozen=True)
class Job:
    """One call of a verb.

    Attributes
    ----------
    verb
        Of the command line.
    stage
        Config section and version; the verb too, but for those of the capture.
    label
        Stage with round and shard; its files in stats/ and logs/ are called so.
    options
        The verb's command line.
    inputs, outputs
        Files that decide whether it must run, and those it promises.
    folders
        Folders that it promises; their manifests stand among the outputs.
    """

    verb: str
    stage: str
    label: str
    options: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    folders: tuple[str, ...] = ()


def plan(scene: Scene) -> list[Job]:
    """List the jobs of a scene, in an order in which every input exists when it is needed.

    Raises
    ------
    FiptError
        If a file or a view that a light setup names is not there.
    """
    scene.check_setups()
    chain = _Chain(scene)
    chain.add_dataset()
    chain.add_check()
    chain.add_samples_and_cache()
    chain.add_segments()
    for round_ in range(scene.rounds + 1):
        chain.add_round(round_)
    chain.add_review()
    chain.add_pictures()
    if scene.exported:
        chain.add_export()
    chain.add_figures()
    return chain.jobs


class _Chain:
    """The jobs of a scene so far, and the files that the next ones read."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.jobs: list[Job] = []
        self.root = f"{RESULTS}/{scene.name}"
        self.data = data = f"{self.root}/dataset"
        self.geometry = [f"{data}/transforms.json", f"{data}/views.json", f"{data}/mesh.ply"]
        self.checked = f"{data}/check_poses.json"
        self.cache, self.environment = f"{self.root}/cache.npz", f"{self.root}/environment.npz"
        self.shards, self.train = scene.shards("all"), list(scene.shards("train"))
        self.samples = {shard: f"{self.root}/samples/{shard}" for shard in self.shards}
        # What holds the pictures, segments and truth of a shard. An import writes the pictures of all views.
        self.images = {shard: [manifest(f"{data}/images.{shard}")] for shard in self.shards}
        if scene.source == "dataset" or scene.photographed:
            self.images = {shard: [manifest(f"{data}/images")] for shard in self.shards}
        if scene.simulated:
            for shard, files in self.images.items():
                files.append(manifest(f"{data}/truth.{shard}"))
        # Of the last round so far: model, its confidence, emitters (perhaps of an earlier one), shading of shards
        self.model = self.emitters = self.confidence = ""
        # Manifest of the list of lamps, and the option that gives their names
        self.listed = ""
        self.lamps: tuple[str, ...] = ()
        self.shading: dict[str, str] = {}
        # Folder of the fused segment ids; none where the fit takes the dataset's
        self.segments = ""
        # Manifests of what the report shows, and the check of the export where there is one
        self.shown: list[str] = []
        self.exported: list[str] = []
        # ... and, beside them, what metrics do not read: light mixer, setups with their own cameras
        self.mixed: list[str] = []

    def add(
        self,
        stage: str,
        label: str,
        options: Iterable[str],
        inputs: Iterable[str],
        outputs: Iterable[str] = (),
        folders: Sequence[str] = (),
        section: str | None = None,
    ) -> None:
        """Add a job; settings and stats are the same options everywhere. ``section`` is the verb's where not named."""
        verb, stage = stage, section or stage
        stats = f"{self.root}/stats/{label}.json"
        common = ("--settings", self.scene.json(stage), "--stats", stats)
        self.jobs.append(
            Job(
                verb=verb,
                stage=stage,
                label=label,
                options=(*options, *common),
                inputs=tuple(dict.fromkeys(inputs)),
                outputs=(*outputs, *map(manifest, folders)),
                folders=tuple(folders),
            )
        )

    def add_dataset(self) -> None:
        """Import the views of another layout, or make them."""
        scene, dataset = self.scene, ("--dataset", self.data)
        developed = self._add_capture() if scene.photographed else []
        if scene.source == "dataset" or scene.photographed:
            listed = manifest(f"{self.data}/images")
            options = (*scene.import_options(), *dataset, "--manifest", listed)
            self.add("import", "import", options, [*scene.source_files(), *developed], [*self.geometry, listed])
        if not scene.synthesized:
            return
        known, files = scene.scene_options(), scene.scene_files()
        room = [*self.geometry] if scene.simulated else [*self.geometry, f"{self.data}/room.json"]
        if not scene.photographed:
            self.add("synthesize", "synthesize", (*dataset, "--room", *known), files, room)
        for shard, views in self.shards.items():
            made = self.images[shard][-1]
            only = ("--truth",) if scene.simulated else ()
            label = f"truth.{shard}" if scene.simulated else f"synthesize.{shard}"
            options = (*dataset, *only, "--views", ",".join(views), *known, "--manifest", made)
            self.add("synthesize", label, options, [*room, *files], [made])
        for setup in scene.true_setups:
            light = ("--setup", scene.setup_json(setup), "--setup-name", setup)
            for shard, views in scene.relit_shards(setup).items():
                made = manifest(f"{self.data}/relight_truth.{setup}.{shard}")
                options = (*dataset, "--views", ",".join(views), *light, *known, "--manifest", made)
                inputs = [*room, *scene.setup_files(setup), *files]
                self.add("synthesize", f"synthesize.{setup}.{shard}", options, inputs, [made])
                self.shown.append(made)

    def _add_capture(self) -> list[str]:
        """Photographs to developed views and their report; return the files that an import reads."""
        scene, root = self.scene, self.root
        photographs, developed = scene.capture_path(), f"{root}/capture"
        calibration, report = f"{developed}/calibration.json", f"{developed}/qa.json"
        if scene.simulated:
            room, known, modelled = ("--dataset", scene.room), scene.scene_options(), scene.scene_files()
            files = [f"{scene.room}/{name}" for name in ("transforms.json", "views.json", "mesh.ply", "room.json")]
            self.add("synthesize", "synthesize", (*room, "--room", *known), modelled, files)
            frames = manifest(f"{root}/raw.calibration")
            options = (*room, "--calibration", photographs, "--manifest", frames)
            self.add("synthesize", "photograph.calibration", options, files, [frames])
            brackets = {shard: [frames, manifest(f"{root}/raw.{shard}")] for shard in self.shards}
            for shard, views in self.shards.items():
                made = brackets[shard][-1]
                options = (*room, "--raw", photographs, "--views", ",".join(views), *known, "--manifest", made)
                self.add("synthesize", f"photograph.{shard}", options, [*files, *modelled], [made])
            calibrated_from = list(dict.fromkeys(file for files in brackets.values() for file in files))
        else:
            brackets = {shard: scene.photographs(views) for shard, views in self.shards.items()}
            # The first photograph tells the camera; which one that is, the table may say.
            calibrated_from = [*scene.calibration_files(), *next(iter(brackets.values()))]
        options = ("--capture", photographs, "--out", calibration)
        self.add("calibrate", "calibrate", options, calibrated_from, [calibration], section="capture")
        made = []
        for shard, views in self.shards.items():
            made.append(manifest(f"{developed}/hdr.{shard}"))
            options = ("--capture", photographs, "--views", ",".join(views), "--calibration", calibration)
            options += ("--out", developed, "--keep-going", "--manifest", made[-1])
            inputs = [calibration, *brackets[shard]]
            self.add("develop", f"develop.{shard}", options, inputs, [made[-1]], section="capture")
        options = ("--capture", photographs, "--developed", developed, "--calibration", calibration, "--out", report)
        self.add("qa", "qa", options, [calibration, *made], [report], section="capture")
        if scene.estimated:
            out, reference = f"{root}/poses", scene.reference_path()
            options = ("--capture", developed, "--held-out", ",".join(scene.views["val"]), "--out", out)
            inputs = [report, *made, *([reference] if reference else [])]
            made_here = [*scene.pose_files, f"{out}/points.ply", f"{out}/poses.png"]
            self.add("pose", "pose", options, inputs, made_here, section="poses")
        return [report, *made]

    def add_check(self) -> None:
        """Check through the mesh that every view shows what the others show; where that is off, accept all unseen."""
        images = [file for files in self.images.values() for file in files] if self.scene.checks_poses else []
        inputs = [*self.geometry, *images]
        self.add("check-poses", "check_poses", (self.data, "--reject"), inputs, [self.checked], section="check_poses")

    def add_samples_and_cache(self) -> None:
        """Trace the samples of every view; gather what the training pictures show of the surface and beyond it."""
        for shard, views in self.shards.items():
            out = self.samples[shard]
            options = ("--dataset", self.data, "--views", ",".join(views), "--out", out)
            self.add("samples", f"samples.{shard}", options, [*self.geometry, self.checked], folders=[out])
        given = self.scene.environment_path()
        inputs = [*self._training_files(), *([given] if given else [])]
        self.add(
            "environment", "environment", (*self._training(), "--out", self.environment), inputs, [self.environment]
        )
        options = (*self._training(), "--out", self.cache)
        self.add("cache", "cache", options, self._training_files(), [self.cache])

    def add_segments(self) -> None:
        """Segment ids of the training views, fused on the mesh, where the fit does not take the dataset's or none."""
        mode, folder = self.scene.segmentation, f"{self.root}/segments"
        if mode in ("dataset", "none"):
            return
        made = []
        for shard in self.train if mode in ("mask2former", "given") else ():
            made.append(manifest(f"{folder}/views.{shard}"))
            samples = self.samples[shard]
            options = ("--dataset", self.data, "--samples", samples, "--out", f"{folder}/views", "--manifest", made[-1])
            files = self.scene.segment_files()
            inputs = [*self.geometry, *self.images[shard], manifest(samples), *files]
            self.add("segment", f"segment.{shard}", options, inputs, [made[-1]])
        self.segments = f"{folder}/fused"
        grown, fused = () if made else ("--geometry",), manifest(self.segments)
        options = ("--dataset", self.data, "--segments", folder, *grown)
        images = [file for shard in self.train for file in self.images[shard]]
        self.add("fuse", "fuse", options, [*self.geometry, self.checked, *images, *made], [fused])

    def add_round(self, round_: int) -> None:
        """Bake or refine the shading, fit the networks, extract the emitters."""
        folder = f"{self.root}/round-{round_}"
        before, model_before, emitters = self.shading, self.model, self.emitters
        self.shading = {shard: f"{folder}/shading/{shard}" for shard in self.train}
        self.model, self.confidence = f"{folder}/model.safetensors", f"{folder}/confidence.npz"
        for shard, out in self.shading.items():
            stage, samples = "bake", self.samples[shard]
            options = (
                "--dataset",
                self.data,
                "--samples",
                samples,
                "--cache",
                self.cache,
                "--environment",
                self.environment,
            )
            inputs = [*self.geometry, manifest(samples), self.cache, self.environment]
            if round_:
                stage, previous = "refine", before[shard]
                options += ("--model", model_before, "--emitters", emitters)
                options += ("--previous", previous)
                inputs += [model_before, emitters, manifest(previous)]
            label = f"{stage}.round-{round_}.{shard}"
            self.add(stage, label, (*options, "--out", out), inputs, folders=[out])

        options = (*self._training(), "--shading", ",".join(self.shading.values()))
        inputs = [*self._training_files(), *map(manifest, self.shading.values())]
        previous = [model_before] if model_before else []
        warm = ["--previous", *previous] if previous else []
        ids = ["--segments", self.segments] if self.segments else []
        fused = [manifest(self.segments)] if self.segments else []
        self.add(
            "fit",
            f"fit.round-{round_}",
            (*options, *warm, "--cache", self.cache, "--environment", self.environment, *ids, "--out", self.model),
            [*inputs, *previous, self.cache, self.environment, *fused],
            [self.model, self.confidence],
        )
        if self.scene.emitters_round(round_) == round_:
            self.emitters = f"{folder}/emitters.npz"
            options += ("--model", self.model, "--out", self.emitters, *self.scene.emission_options())
            made = [self.emitters, f"{folder}/emitters.json"]
            self.add("emitters", f"emitters.round-{round_}", options, [*inputs, self.model], made)

    def add_review(self) -> None:
        """The lamps for people, with names and pictures, and the file in which they decide."""
        folder = f"{self.root}/emitters"
        options = (*self._training(), "--emitters", self.emitters, "--out", folder)
        options += ("--review", f"{self.root}/{REVIEW_FILE}", *self.scene.listing_options())
        self.add("review", "review", options, [*self._training_files(), self.emitters], folders=[folder])
        self.listed, self.lamps = manifest(folder), ("--lamps", f"{folder}/emitters.json")

    def add_pictures(self) -> None:
        """Material maps of every view, held-out views, relit views."""
        model = ("--model", self.model, "--emitters", self.emitters)
        traced = ("--cache", self.cache, "--environment", self.environment, *model)
        for shard in self.shards:
            self._add_picture("materials", "materials", shard, (*model, "--confidence", self.confidence))
        for shard in self.scene.shards("val"):
            self._add_picture("render", "render", shard, traced)
        for setup in self.scene.setups:
            options, files = (*traced, "--setup", self.scene.setup_json(setup)), self.scene.setup_files(setup)
            if self.scene.names_in(setup):
                options, files = (*options, *self.lamps), [*files, self.listed]
            if self.scene.names_fused(setup):
                options += ("--segments", f"{self.root}/segments/fusion.npz")
                files = [*files, manifest(self.segments)]
            if setup in self.scene.filmed:
                self._add_film(setup, options, files)
                continue
            for shard in self.scene.relit_shards(setup):
                self._add_picture("relight", f"relight/{setup}", shard, options, files)

        for shard, views in self.scene.lamp_shards().items():
            made = manifest(f"{self.root}/olat.{shard}")
            options = ("--dataset", self.data, "--samples", self.samples[shard], *traced, "--views", ",".join(views))
            options += ("--out", f"{self.root}/lamps", "--manifest", made)
            inputs = [*self.geometry, manifest(self.samples[shard]), self.model, self.emitters]
            self.add("olat", f"olat.{shard}", options, [*inputs, self.cache, self.environment], [made])
            self.mixed.append(made)

    def _add_film(self, setup: str, options: Iterable[str], files: Iterable[str]) -> None:
        """What a setup's own cameras see, shard by shard; then these joined."""
        shards, name = self.scene.relit_shards(setup), f"relight/{setup}"
        traced = next(iter(self.samples))  # its settings are those of the cameras' samples
        placed = [*files, self.checked]  # keyframes, directions and sizes are those of accepted views
        for shard, cameras in shards.items():
            self._add_picture("relight", name, shard, (*options, "--cameras", ",".join(cameras)), placed, traced)
        seen = [self.shown.pop() for _ in shards]  # the page shows what is made of them
        folder, made = f"{self.root}/{name}", manifest(f"{self.root}/{name}")
        options = ("--dataset", self.data, "--cameras", self.scene.cameras_json(setup), "--pictures", folder)
        options += ("--max-views", str(self.scene.settings["report"].max_views))
        images = [file for files in self.images.values() for file in files]
        inputs = [*self.geometry, self.checked, *images, *seen]
        self.add("video", f"video.{setup}", (*options, "--manifest", made), inputs, [made])
        self.mixed.append(made)

    def _add_picture(
        self,
        stage: str,
        name: str,
        shard: str,
        options: Iterable[str],
        files: Iterable[str] = (),
        traced: str | None = None,
    ) -> None:
        samples, made = self.samples[traced or shard], manifest(f"{self.root}/{name}.{shard}")
        label = f"{name.replace('/', '.')}.{shard}"
        options = ("--dataset", self.data, "--samples", samples, *options)
        options += ("--out", f"{self.root}/{name}", "--manifest", made)
        inputs = [*self.geometry, manifest(samples), self.model, self.emitters, *files]
        extra = {"--cache": self.cache, "--environment": self.environment, "--confidence": self.confidence}
        inputs += [path for flag, path in extra.items() if flag in options]
        self.add(stage, label, options, inputs, [made])
        self.shown.append(made)

    def add_export(self) -> None:
        """The room for other programs, and every file of it loaded back."""
        out, made = f"{self.root}/export", manifest(f"{self.root}/export")
        samples = [self.samples[shard] for shard in self.train]
        files = {
            "--model": self.model,
            "--emitters": self.emitters,
            "--confidence": self.confidence,
            "--environment": self.environment,
        }
        options = ("--name", self.scene.name, "--dataset", self.data, "--samples", ",".join(samples))
        options += tuple(text for pair in files.items() for text in pair)
        options += self.lamps
        inputs = [*self.geometry, *map(manifest, samples), *files.values(), self.listed]
        self.add("export", "export", (*options, "--out", out, "--manifest", made), inputs, [made])
        self.exported = [f"{out}/check.json"]
        held_out = self.scene.shards("val")
        samples = [self.samples[shard] for shard in held_out]
        options = ("--dataset", self.data, "--samples", ",".join(samples), "--export", out)
        options += ("--render", f"{self.root}/render", "--out", *self.exported)
        inputs = [*self.geometry, made, *map(manifest, samples)]
        inputs += [manifest(f"{self.root}/render.{shard}") for shard in held_out]
        self.add("check-export", "check-export", options, inputs, self.exported, section="export")

    def add_figures(self) -> None:
        """Metrics and the page."""
        metrics, report = f"{self.root}/metrics.json", f"{self.root}/report.html"
        options = ["--dataset", self.data, "--samples", ",".join(self.samples.values())]
        for name in ("materials", "render", "relight"):
            options += [f"--{name}", f"{self.root}/{name}"]
        options += [f"--setups={','.join(sorted(self.scene.true_setups))}"]
        for setup, folder in self.scene.references.items():
            options += ["--reference", f"{setup}={folder}"]
        options += ["--emitters", self.emitters, "--out", metrics]
        inputs = [*self.geometry, *(file for files in self.images.values() for file in files)]
        inputs += map(manifest, self.samples.values())
        inputs += [*self.shown, self.emitters, *self.scene.reference_files()]
        self.add("metrics", "metrics", options, inputs, [metrics])
        options = ("--results", self.root, "--out", report)
        seen, filmed = (",".join(sorted(names)) for names in (self.scene.relit, self.scene.filmed))
        options += (f"--setups={seen}", f"--films={filmed}")
        self.add("report", "report", options, [metrics, *inputs, self.listed, *self.mixed, *self.exported], [report])

    def _training(self) -> tuple[str, ...]:
        samples = ",".join(self.samples[shard] for shard in self.train)
        return "--dataset", self.data, "--samples", samples

    def _training_files(self) -> list[str]:
        images = [file for shard in self.train for file in self.images[shard]]
        return [*self.geometry, *images, *(manifest(self.samples[shard]) for shard in self.train)]


def manifest(folder: str) -> str:
    """Return the manifest of a folder output, which stands beside it."""
    return f"{folder}.manifest.json"


def run(scene: Scene, call: Callable[[Job], None]) -> None:
    """Run every job of a scene that is not up to date; results are those of the workflow.

    Parameters
    ----------
    scene
        What to run.
    call
        Calls the verb of a job; whatever it raises ends the run.

    Raises
    ------
    FiptError
        A file that no job makes is missing, another run works on the scene, or a job did not write what it promises.
    """
    jobs, hashes = plan(scene), Hashes()
    check_sources(jobs)
    records = Path(RESULTS, scene.name, ".run")
    with locked(scene.name):
        for number, job in enumerate(jobs, 1):
            record = records / f"{job.label}.json"
            head = f"[{number}/{len(jobs)}] {job.label}"
            if record.is_file() and record.read_text(encoding="utf-8") == described(job, hashes):
                print(f"{head}: up to date", file=sys.stderr)
                continue
            print(head, file=sys.stderr)
            start = time.perf_counter()
            clear(job, record)
            call(job)
            for path in job.outputs:
                existing_file(path, f"an output of {job.label}")
            write_text(record, described(job, hashes))
            print(f"{head}: {time.perf_counter() - start:.1f} s", file=sys.stderr)


def check_sources(jobs: Iterable[Job]) -> None:
    """Refuse a plan whose given files are not all there: maps, ids and poses may be read hours after the start."""
    made: set[str] = set()
    for job in jobs:
        for path in job.inputs:
            if path not in made:
                existing_file(path, f"an input of {job.label}")
        made.update(job.outputs)


def clear(job: Job, record: Path) -> None:
    """Remove what an older run of the job left, so that nothing old is taken for its output."""
    record.unlink(missing_ok=True)
    for path in job.outputs:
        Path(path).unlink(missing_ok=True)
    for path in job.folders:
        shutil.rmtree(path, ignore_errors=True)


class Hashes:
    """SHA-256 of files, each read once for as long as its size and time do not change."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, int, int], str] = {}

    def of(self, path: str) -> str:
        """Hash of a file's content; "missing" where there is none."""
        try:
            state = Path(path).stat()
        except FileNotFoundError:
            return "missing"
        key = (path, state.st_mtime_ns, state.st_size)
        if key not in self._known:
            self._known[key] = file_hash(path)
        return self._known[key]


def described(job: Job, hashes: Hashes) -> str:
    """Return what a job's record says when it is up to date, as JSON."""
    content = {
        "stage": job.stage,
        "version": VERSIONS[job.stage],
        "options": job.options,
        "inputs": {path: hashes.of(path) for path in job.inputs},
        "outputs": {path: hashes.of(path) for path in job.outputs},
        "folders": {path: Path(path).is_dir() for path in job.folders},
    }
    return json.dumps(content, indent=1, sort_keys=True) + "\n"


@contextmanager
def locked(scene: str) -> Iterator[None]:
    """Let one run at a time work on a scene; the lock ends with the process, however that ends."""
    path = Path(RESULTS, scene, ".run", "lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
    except OSError as error:
        raise FiptError(f"{path} cannot be written ({error.strerror})", "check the folder's permissions") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise FiptError(f"another run works on scene {scene}", "wait for it to end, or stop it") from None
        yield
