"""Buckets of moto, for tests of object storage."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import boto3
import pytest
from moto import mock_aws

from fipt.bucket import Bucket


@contextmanager
def empty_bucket(url: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """An empty bucket ``rooms``, and a folder as the working directory."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.delenv("AWS_ENDPOINT_URL", raising=False)
    monkeypatch.setattr("fipt.bucket._OPEN", {})
    with mock_aws():
        boto3.client("s3", region_name="us-east-1").create_bucket(Bucket="rooms")
        yield Bucket(url)
