"""Results in object storage: Snakemake's plugin for S3, with what it does not know of our files.

A file that a job reads or writes lies at the same path here as without a store, so that parameters may name folders. A
manifest goes with the files that it lists. The records that Snakemake keeps of jobs lie in the bucket, too: on
another machine a room is up to date, and jobs whose settings have changed run again.
"""

from __future__ import annotations

import json
import os
import shutil
from collections import defaultdict
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

from snakemake import workflow as workflows
from snakemake.io import flag
from snakemake.path_modifier import PATH_MODIFIER_FLAG
from snakemake.persistence import MetadataRecord
from snakemake.persistence.file import FilePersistence
from snakemake.settings.types import ExecMode
from snakemake_interface_storage_plugins.io import Mtime
from snakemake_storage_plugin_s3 import StorageObject

from fipt.bucket import Bucket, Stored, opened
from fipt.config.layout import RESULTS
from fipt.errors import FiptError
from fipt.formats.files import write_text
from fipt.formats.manifests import file_hash, listed_files, listed_in

RECORDS = ".records"
"""Folder of a room's results with what Snakemake knows of its jobs."""
_MANIFEST = ".manifest.json"
_FOLDER_TIME = ".snakemake_timestamp"
"""Snakemake's file in a folder for the folder's time, which it sets after the folder is stored: not ours to store."""
_BESIDE = {"emitters.manifest.json": "emitters_review.yaml"}
"""Manifest -> what its job writes beside it, for people: no output, since Snakemake would remove it."""


def keep_rooms(workflow: Any) -> Bucket:
    """Let a workflow that is being read keep its results in the bucket of its default storage; return that.

    Raises
    ------
    FiptError
        If the bucket cannot be reached.
    """
    provider = workflow.storage_registry.default_storage_provider
    bucket = opened(workflow.storage_settings.default_storage_prefix, provider.settings)
    bucket.check()
    StoredFile.store = RoomRecords.store = bucket
    provider.get_storage_object_cls = lambda: StoredFile
    if workflow.exec_mode == ExecMode.DEFAULT:  # jobs elsewhere write no records
        workflows.FilePersistence = RoomRecords
    paths = workflow.modifier.path_modifier
    store = paths.apply_default_storage

    def modify(path: Any, property: str | None = None) -> Any:
        """Store what lies below results/: inputs from elsewhere are files that every machine sees."""
        if not isinstance(path, str) or not path.startswith(f"{RESULTS}/"):
            return path
        return flag(store(path), PATH_MODIFIER_FLAG)

    paths.modify = modify
    return bucket


def keep_sheet(bucket: Bucket, sheet: Any, elsewhere: bool) -> None:
    """Let jobs on other machines find the sheet of rooms, which Snakemake does not send with the configuration.

    Parameters
    ----------
    bucket
        As `keep_rooms` returns it.
    sheet
        What the configuration says of its scenes: a path within the working directory, or anything else, which stays.
    elsewhere
        Whether this is such a machine.
    """
    if not isinstance(sheet, str) or Path(sheet).is_absolute() or ".." in Path(sheet).parts:
        return
    if elsewhere:
        bucket.fetch({sheet: Path(sheet)})
    elif Path(sheet).is_file():  # else it is refused when it is read
        bucket.put([Path(sheet)])


def prefer_stored(jobs: Iterable[Any]) -> None:
    """Let Snakemake fetch the inputs of jobs that are other here than in the bucket, which it holds for current.

    It compares times alone: what a run without a store has made would be newer, and the bucket would lack it.
    """
    for job in jobs:
        for path in job.input:
            if path.is_storage and str(path) in StoredFile.other and Path(path).exists():
                path.touch((0, 0))


class StoredFile(StorageObject):
    """A file or folder of the results in a bucket.

    Attributes
    ----------
    store
        The bucket.
    other
        Files that are not here as they are in the bucket, and folders that hold such.
    """

    store: Bucket
    other: ClassVar[set[str]] = set()

    @cached_property
    def path(self) -> Path:
        """Where it lies here."""
        return Path(self.query.removeprefix(f"{self.store.url}/"))

    def local_path(self) -> Path:
        """Where it lies here, unless Snakemake says another place."""
        return self._overwrite_local_path or self.path

    def cache_key(self, local_suffix: str | None = None) -> str:
        """Name under which Snakemake remembers what it knows."""
        return str(self.path) if local_suffix is None else local_suffix

    def get_inventory_parent(self) -> str:
        """Folder whose files are looked up together: the room."""
        return "/".join(self.path.parts[:2])

    async def inventory(self, cache: Any) -> None:
        """Look up all files of the room at once; a copy that is older or newer here counts as none."""
        room = self.get_inventory_parent()
        if room in cache.exists_in_storage.has_inventory:
            return
        times: dict[str, float] = defaultdict(float)
        for path, stored in self.store.files(room).items():
            cache.size[path] = stored.size
            places = (path, *map(str, PurePosixPath(path).parents))
            if not self.store.is_here(Path(path), stored):
                cache.exists_local[path] = False
                self.other.update(places)
            for place in places:  # a folder is as new as what is in it
                times[place] = max(times[place], stored.time)
        for place, time in times.items():
            cache.mtime[place] = Mtime(storage=time)
            cache.exists_in_storage[place] = True
        cache.exists_in_storage.has_inventory.add(room)

    def exists(self) -> bool:
        """Whether it is in the bucket."""
        return self._stored() is not None

    def mtime(self) -> float:
        """When it was written, by the clock of the storage."""
        stored = self._stored()
        if stored is None:
            raise FiptError(f"{self.query} is gone", "run again")
        return stored.time

    def size(self) -> int:
        """Bytes; the bucket is not asked for those of a file that is here."""
        stored = None if self.path.is_file() else self._stored()
        return self.path.stat().st_size if stored is None else stored.size

    def retrieve_object(self) -> None:
        """Fetch it, after what it lists, and a folder under another name: a copy that is cut never looks whole."""
        if self._is_folder():
            part = self.path.with_name(f".{self.path.name}.part")
            shutil.rmtree(part, ignore_errors=True)
            files = self.store.files(str(self.path))
            self.store.fetch({file: part / Path(file).relative_to(self.path) for file in files})
            shutil.rmtree(self.path, ignore_errors=True)
            os.replace(part, self.path)
            return
        if self.path.name.endswith(_MANIFEST):
            listed = listed_in(self.store.read(self.path)).items()
            files = [file for name, value in listed if not _is(file := self.path.parent / name, value)]
            self.store.fetch({file: file for file in files})
        self.store.fetch({self.path: self.path})

    def store_object(self) -> None:
        """Send it, after what it lists."""
        local = self.local_path()
        if local != self.path:
            super().store_object()
        elif local.is_dir():
            self.store.put(path for path in local.rglob("*") if path.is_file() and path.name != _FOLDER_TIME)
        else:
            self.store.put(_with(local))
            self.store.put([local])

    def remove(self) -> None:
        """Remove it, or what is in it; Snakemake's own would remove an empty bucket as well."""
        self.store.remove(self.store.files(str(self.path)) if self._is_folder() else [self.path])

    def _is_folder(self) -> bool:
        return not self.path.suffix  # all our files have an ending

    def _stored(self) -> Stored | None:
        """What the bucket knows of it; a folder is as new as what is in it."""
        if not self._is_folder():
            return self.store.stored(self.path)
        files = self.store.files(str(self.path)).values()
        return Stored(max(file.time for file in files), sum(file.size for file in files)) if files else None


class RoomRecords(FilePersistence):
    """What Snakemake knows of the jobs of a room, in the room's results, here and in the bucket."""

    store: Bucket

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self._fetched: set[str] = set()

    def _read_record(self, key: str) -> MetadataRecord | None:
        path = self._record(key)
        if path is None:
            return super()._read_record(key)
        folder = str(path.parent)
        if folder not in self._fetched:
            self._fetched.add(folder)
            self.store.fetch_newer(folder)
        return MetadataRecord.model_validate_json(path.read_bytes()) if path.is_file() else None

    def _write_record(self, key: str, record: MetadataRecord) -> None:
        path = self._record(key)
        if path is None:
            super()._write_record(key, record)
            return
        write_text(path, json.dumps(dict(record.items()), indent=1) + "\n")
        self.store.put([path])

    def _delete_record(self, key: str) -> bool:
        path = self._record(key)
        if path is None:
            return super()._delete_record(key)
        path.unlink(missing_ok=True)
        self.store.remove([path])
        return True

    def _record(self, key: str) -> Path | None:
        """File of a record; None where the results do not hold what it tells of."""
        path = PurePosixPath(key.removeprefix(f"{self.store.url}/"))
        if path.parts[:1] != (RESULTS,):
            return None
        results, room, *names = path.parts
        return Path(results, room, RECORDS, "@".join(names) + ".json")


def _with(file: Path) -> list[Path]:
    """Files that are stored before a file: what a manifest lists, and what its job wrote beside it."""
    if not file.name.endswith(_MANIFEST):
        return []
    beside = [file.with_name(name) for manifest, name in _BESIDE.items() if manifest == file.name]
    return [*(file.parent / name for name in listed_files(file)), *(path for path in beside if path.is_file())]


def _is(file: Path, value: str) -> bool:
    return file.is_file() and file_hash(file) == value
