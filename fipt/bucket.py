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
        When it was written, by the clock of the storage, in seconds.
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


def opened(url: str, client: Any = None) -> Bucket:
    """Return the bucket of a URL: one object a process, which remembers what it has sent; parameters as of `Bucket`."""
    url = url.rstrip("/")
    if url not in _OPEN:
        _OPEN[url] = Bucket(url, client)
    return _OPEN[url]


class Bucket:
    """Files below a prefix of a bucket.

    Parameters
    ----------
    url
        s3://BUCKET or s3://BUCKET/PREFIX.
    client
        Of boto3, which speaks to the storage; None: one of the environment (AWS_ENDPOINT_URL, AWS_ACCESS_KEY_ID, ...).

    Raises
    ------
    FiptError
        If the URL is none, boto3 is missing, or its settings are wrong.
    """

    def __init__(self, url: str, client: Any = None) -> None:
        self.url = url.rstrip("/")
        self.name, self._prefix = parted(url)
        self._sent: dict[Path, tuple[int, int]] = {}
        with self.readable():
            self._client = client or _client()

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
                    found[path] = Stored(each["LastModified"].timestamp(), each["Size"])
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
            return Stored(found["LastModified"].timestamp(), found["ContentLength"])

    def put(self, paths: Iterable[Path]) -> None:
        """Send files; those that this process has sent and that are as they were stay."""
        new = {path: state for path in paths if self._sent.get(path) != (state := _state(path))}
        self._each(lambda path: self._client.upload_file(str(path), self.name, self.key(path)), new)
        self._sent |= new

    def fetch(self, wanted: Mapping[str | Path, Path]) -> None:
        """Fetch files: path in the bucket -> where it goes; each appears under its name when it is whole."""

        def fetch(item: tuple[str | Path, Path]) -> None:
            item[1].parent.mkdir(parents=True, exist_ok=True)
            self._client.download_file(self.name, self.key(item[0]), str(item[1]))

        self._each(fetch, wanted.items())

    def fetch_newer(self, folder: str) -> None:
        """Fetch what is missing below a folder here, or newer in the bucket; times here are those of the bucket."""
        newer = {path: stored for path, stored in self.files(folder).items() if not self.is_here(Path(path), stored)}
        self.fetch({path: Path(path) for path in newer})
        for path, stored in newer.items():
            os.utime(path, (stored.time, stored.time))

    def share(self, paths: Iterable[str | Path]) -> None:
        """Let the newer of two files win, that here or that in the bucket; times here are those of the bucket."""

        def share(path: str | Path) -> None:
            here = Path(path)
            there = self.stored(path)
            if here.is_file() and (there is None or here.stat().st_mtime > there.time):
                self._client.upload_file(str(path), self.name, self.key(path))
                there = self.stored(path)
            elif there is not None and not self.is_here(here, there):
                here.parent.mkdir(parents=True, exist_ok=True)
                self._client.download_file(self.name, self.key(path), str(path))
            if there is not None:
                os.utime(path, (there.time, there.time))

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
        """Whether a file is here as it is in the bucket, or newer."""
        if not path.is_file():
            return False
        state = _state(path)
        return self._sent.get(path) == state or (state[0] == stored.size and state[1] >= stored.time * 1e9)

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
        except (Boto3Error, BotoCoreError, ClientError, ValueError) as error:
            raise FiptError(*self._said(error)) from error

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
        if code in ("404", "NoSuchBucket"):
            return f"there is no bucket {self.name!r}", "make it, or correct the URL"
        if code:
            return f"the storage refuses {self.url} ({error})", "check the credentials and what they allow"
        if kind == "ValueError":
            return f"{self.url} cannot be used ({error})", "check AWS_ENDPOINT_URL"
        return f"{self.url} cannot be reached ({error})", "check the network and AWS_ENDPOINT_URL, then run again"


_OPEN: dict[str, Bucket] = {}


def _client() -> Any:
    import boto3
    from botocore.config import Config

    # Checksums that other servers than Amazon's do not know would become part of the files.
    plain = Config(
        connect_timeout=10,
        request_checksum_calculation="when_required",
        response_checksum_validation="when_required",
        retries={"max_attempts": 5, "mode": "standard"},
    )
    return boto3.Session().client("s3", region_name=os.environ.get("AWS_DEFAULT_REGION", "us-east-1"), config=plain)


def _state(path: Path) -> tuple[int, int]:
    state = path.stat()
    return state.st_size, state.st_mtime_ns
