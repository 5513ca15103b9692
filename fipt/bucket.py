"""Results in a bucket of object storage (S3): their paths there are those of the working directory, below a prefix."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fipt.errors import FiptError

AT_A_TIME = 8
"""Files that are sent or fetched at the same time: most are small, and wait for an answer."""
_URL = re.compile(r"s3://([a-z0-9][a-z0-9.-]{1,61}[a-z0-9])(?:/(.*))?")


@dataclass(frozen=True)
class Stored:
    """What a bucket says of a file.

    Attributes
    ----------
    time
        When it was written, by the clock of the storage, in whole seconds: some storages tell parts of them in
        listings only.
    size
        Bytes.
    """

    time: float
    size: int


def parted(url: str) -> tuple[str, str]:
    """Bucket and prefix of a URL.

    Raises
    ------
    FiptError
        If it is none of S3.
    """
    found = _URL.fullmatch(url.rstrip("/"))
    if found is None:
        raise FiptError(f"a store must be s3://BUCKET or s3://BUCKET/PREFIX; this is {url!r}", "correct the URL")
    return found[1], found[2] or ""


def opened(url: str, settings: Any = None) -> Bucket:
    """Return the bucket of a URL: one object a process, which remembers what it has sent; parameters as of `Bucket`."""
    url = url.rstrip("/")
    if url not in _OPEN:
        _OPEN[url] = Bucket(url, settings)
    return _OPEN[url]


class Bucket:
    """Files below a prefix of a bucket.

    A file that was sent or fetched has the time of the object here, too: any other time tells of other content.

    Parameters
    ----------
    url
        s3://BUCKET or s3://BUCKET/PREFIX.
    settings
        What says where the storage is (endpoint_url, region, access_key, ...); None: the environment
        (AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID, ...).

    Raises
    ------
    FiptError
        If the URL is none, boto3 is missing, or its settings are wrong.
    """

    def __init__(self, url: str, settings: Any = None) -> None:
        self.url = url.rstrip("/")
        self.name, self._prefix = parted(url)
        self._sent: dict[Path, tuple[int, int]] = {}
        with self.readable():
            try:
                self._client = _client(settings)
            except ValueError as error:
                raise FiptError(f"{self.url} cannot be used ({error})", "check AWS_ENDPOINT_URL") from error

    def check(self) -> None:
        """Look whether the bucket is there, and may be read.

        Raises
        ------
        FiptError
            If it is not.
        """
        with self.readable():
            self._client.head_bucket(Bucket=self.name)

    def files(self, folder: str) -> dict[str, Stored]:
        """Path -> what is known of it, of every file below a folder."""
        found = {}
        with self.readable():
            pages = self._client.get_paginator("list_objects_v2")
            for page in pages.paginate(Bucket=self.name, Prefix=self.key(f"{folder}/")):
                for each in page.get("Contents", ()):
                    path = each["Key"][len(self.key("")) :]
                    found[path] = Stored(each["LastModified"].timestamp() // 1, each["Size"])
        return found

    def stored(self, path: str | Path) -> Stored | None:
        """What is known of a file; None where there is none."""
        from botocore.exceptions import ClientError

        with self.readable():
            try:
                found = self._client.head_object(Bucket=self.name, Key=self.key(path))
            except ClientError as error:
                if error.response["Error"]["Code"] != "404":
                    raise
                return None
            return Stored(found["LastModified"].timestamp() // 1, found["ContentLength"])

    def put(self, paths: Iterable[Path]) -> None:
        """Send files; those that this process has sent and that are as they were stay."""
        self._each(self._send, [path for path in paths if self._sent.get(path) != _state(path)])

    def fetch(self, wanted: Mapping[str | Path, Path]) -> None:
        """Fetch files: path in the bucket -> where it goes; each appears under its name when it is whole."""

        def fetch(item: tuple[str | Path, Path]) -> None:
            stored = self.stored(item[0])
            if stored is None:
                raise FiptError(f"a file is missing in {self.url} ({item[0]})", "run again")
            self._fetch(*item, stored)

        self._each(fetch, wanted.items())

    def fetch_newer(self, folder: str) -> None:
        """Fetch what is missing below a folder here, or newer in the bucket; what is newer here stays."""

        def fetch(item: tuple[str, Stored]) -> None:
            path = Path(item[0])
            if not self.is_here(path, item[1]) and not _is_newer(path, item[1]):
                self._fetch(path, path, item[1])

        self._each(fetch, self.files(folder).items())

    def share(self, paths: Iterable[str | Path]) -> None:
        """Let the newer of two files win, that here or that in the bucket; times here are those of the bucket."""

        def share(path: str | Path) -> None:
            here = Path(path)
            there = self.stored(path)
            if here.is_file() and (there is None or _is_newer(here, there)):
                self._send(here)
            elif there is not None and not self.is_here(here, there):
                self._fetch(path, here, there)

        self._each(share, paths)

    def read(self, path: str | Path) -> bytes:
        """Content of a file."""
        with self.readable():
            return self._client.get_object(Bucket=self.name, Key=self.key(path))["Body"].read()

    def remove(self, paths: Iterable[str | Path]) -> None:
        """Remove files."""
        paths = list(paths)
        for path in paths:
            self._sent.pop(Path(path), None)
        self._each(lambda path: self._client.delete_object(Bucket=self.name, Key=self.key(path)), paths)

    def is_here(self, path: Path, stored: Stored) -> bool:
        """Whether a file is here as it is in the bucket: neither older nor newer."""
        return path.is_file() and _state(path) == (stored.size, int(stored.time) * 10**9)

    def key(self, path: str | Path) -> str:
        """Name of a file in the bucket."""
        return f"{self._prefix}/{path}" if self._prefix else str(path)

    @contextmanager
    def readable(self) -> Iterator[None]:
        """Let errors of the storage be one line.

        Raises
        ------
        FiptError
            Where the user can mend it.
        """
        try:
            from boto3.exceptions import Boto3Error
            from botocore.exceptions import BotoCoreError, ClientError
        except ModuleNotFoundError as error:
            raise FiptError(f"{self.url} needs the package {error.name}", "pip install 'fipt[s3]'") from None
        try:
            yield
        except (Boto3Error, BotoCoreError, ClientError) as error:
            raise FiptError(*self._said(error)) from error

    def _send(self, path: Path) -> None:
        """Send a file; it gets the time of the object unless somebody wrote it meanwhile."""
        sent = _state(path)
        self._client.upload_file(str(path), self.name, self.key(path))
        stored = self.stored(path)
        if stored is not None and stored.size == sent[0] and _state(path) == sent:
            os.utime(path, (stored.time, stored.time))
            sent = _state(path)
        self._sent[path] = sent

    def _fetch(self, path: str | Path, here: Path, stored: Stored) -> None:
        """Fetch a file, of which this is known."""
        here.parent.mkdir(parents=True, exist_ok=True)
        self._client.download_file(self.name, self.key(path), str(here))
        os.utime(here, (stored.time, stored.time))

    def _each(self, call: Callable[[Any], None], paths: Iterable[Any]) -> None:
        with self.readable(), ThreadPoolExecutor(AT_A_TIME) as pool:
            list(pool.map(call, paths))

    def _said(self, error: Exception) -> tuple[str, str]:
        """Say what is wrong, and what to do about it."""
        kind, code = type(error).__name__, getattr(error, "response", {}).get("Error", {}).get("Code", "")
        if "Credential" in kind or kind == "ProfileNotFound":
            return (
                f"there are no credentials for {self.url} ({error})",
                "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY",
            )
        if code == "NoSuchKey" or (code == "404" and getattr(error, "operation_name", "") != "HeadBucket"):
            return f"a file is missing in {self.url} ({error})", "run again"
        if code in ("404", "NoSuchBucket"):
            return f"there is no bucket {self.name!r}", "make it, or correct the URL"
        if code:
            return f"the storage refuses {self.url} ({error})", "check the credentials and what they allow"
        return f"{self.url} cannot be reached ({error})", "check the network and AWS_ENDPOINT_URL, then run again"


_OPEN: dict[str, Bucket] = {}


def _client(settings: Any) -> Any:
    import boto3
    from botocore.config import Config

    # Checksums that other servers than Amazon's do not know would become part of the files.
    plain = Config(
        connect_timeout=10,
        request_checksum_calculation="when_required",
        response_checksum_validation="when_required",
        retries={"max_attempts": 5, "mode": "standard"},
    )
    session = boto3.Session()
    if settings is None:
        return session.client("s3", region_name=os.environ.get("AWS_DEFAULT_REGION", "us-east-1"), config=plain)
    own = Config(
        signature_version=settings.signature_version, retries={"max_attempts": settings.retries, "mode": "standard"}
    )
    return session.client(
        "s3",
        endpoint_url=settings.endpoint_url,
        region_name=settings.region,
        aws_access_key_id=settings.access_key,
        aws_secret_access_key=settings.secret_key,
        aws_session_token=settings.token,
        config=plain.merge(own),
    )


def _is_newer(path: Path, stored: Stored) -> bool:
    """Whether a file was written here after it was stored."""
    return path.is_file() and path.stat().st_mtime > stored.time


def _state(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_size, state.st_mtime_ns
