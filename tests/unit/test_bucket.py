"""Files in a bucket: sent once, fetched when they are newer, and one line for whatever is wrong."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from fipt.bucket import Bucket, opened, parted
from fipt.errors import FiptError
from tests.buckets import empty_bucket

URL = "s3://rooms/lab"


@pytest.fixture
def bucket(tmp_path, monkeypatch):
    """A bucket of moto, and an empty working directory."""
    with empty_bucket(URL, tmp_path, monkeypatch) as made:
        yield made


def write(path: str, text: str, time: float | None = None) -> Path:
    """Write a file; its time is seconds from now."""
    file = Path(path)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    if time is not None:
        os.utime(file, (file.stat().st_mtime + time,) * 2)
    return file


@pytest.mark.parametrize(
    ("url", "parts"),
    [("s3://rooms", ("rooms", "")), ("s3://rooms/", ("rooms", "")), ("s3://rooms/a/b/", ("rooms", "a/b"))],
)
def test_a_url_has_a_bucket_and_a_prefix(url, parts):
    assert parted(url) == parts
    assert opened(url) is opened(url.rstrip("/"))


@pytest.mark.parametrize("url", ["", "rooms", "s3:/rooms", "s3://", "s3://R", "gs://rooms", "/tmp/rooms"])
def test_other_urls_are_refused(url):
    with pytest.raises(FiptError, match="a store must be s3://BUCKET or s3://BUCKET/PREFIX"):
        parted(url)


def test_files_keep_their_paths_below_the_prefix(bucket):
    bucket.put([write("results/a/x.json", "one"), write("results/a/b/y.json", "two"), write("results/ab/z.json", "no")])
    assert set(bucket.files("results/a")) == {"results/a/x.json", "results/a/b/y.json"}
    assert bucket.read("results/a/x.json") == b"one"
    assert bucket.key("results/a") == "lab/results/a"
    assert bucket.stored("results/a/b/y.json").size == 3
    bucket.fetch({"results/a/x.json": Path("deep/er/x.json")})
    assert Path("deep/er/x.json").read_text() == "one"
    bucket.remove(["results/a/x.json"])
    assert bucket.stored("results/a/x.json") is None


def test_what_was_sent_is_sent_again_only_when_it_has_changed(bucket):
    file = write("results/a/x.json", "one")
    bucket.put([file])
    Bucket(URL).remove([file])
    bucket.put([file])
    assert bucket.files("results") == {}
    bucket.put([write("results/a/x.json", "three")])
    assert bucket.read(file) == b"three"


def test_other_files_of_one_size_are_not_here(bucket):
    file = write("results/a/x.json", "one", -100)
    bucket.put([file])
    assert Bucket(URL).is_here(file, bucket.stored(file))
    assert Bucket(URL).is_here(file, bucket.files("results")[str(file)])
    for time in (-100, 100):
        write("results/a/x.json", "two", time)
        assert not bucket.is_here(file, bucket.stored(file))
    bucket.fetch({file: file})
    assert bucket.is_here(file, bucket.stored(file))
    write("results/a/x.json", "one")
    Bucket(URL).put([write("results/a/x.json", "more")])
    write("results/a/x.json", "one", -100)
    assert not bucket.is_here(file, bucket.stored(file)), "another process has sent another one since"


def test_what_is_written_while_it_is_sent_keeps_its_time(bucket, monkeypatch):
    file, send = write("results/a/x.json", "one"), bucket._client.upload_file

    def edited(*args):
        send(*args)
        write("results/a/x.json", "two", 50)

    with monkeypatch.context() as patch:
        patch.setattr(bucket._client, "upload_file", edited)
        bucket.put([file])
    assert file.stat().st_mtime > bucket.stored(file).time
    bucket.put([file])
    assert bucket.read(file) == b"two"


def test_what_is_newer_in_the_bucket_is_fetched(bucket):
    old, new, own, longer = (write(f"results/a/{name}", "here!") for name in ("old", "new", "own", "longer"))
    Bucket(URL).put([old, new, longer])
    bucket.put([own])
    write("results/a/old", "older", -100)
    write("results/a/new", "newer", 100)
    write("results/a/longer", "newer, and longer", 100)
    write("results/a/here", "only")
    own.unlink()
    bucket.fetch_newer("results/a")
    assert old.read_text() == own.read_text() == "here!"
    assert new.read_text() == "newer"
    assert longer.read_text() == "newer, and longer"
    assert old.stat().st_mtime == bucket.stored(old).time


def test_shared_files_go_the_way_of_the_newer_one(bucket):
    here, there, neither = "results/a/here", "results/a/there", "results/a/neither"
    Bucket(URL).put([write(here, "old"), write(there, "new")])
    write(here, "mine", 100)
    write(there, "mine", -100)
    bucket.share([here, there, neither])
    assert bucket.read(here) == b"mine"
    assert Path(there).read_text() == "new"
    assert not Path(neither).exists()
    assert Path(here).stat().st_mtime == bucket.stored(here).time


def test_settings_say_where_the_storage_is(bucket):
    given = {"endpoint_url": "http://127.0.0.1:9", "region": "eu-west-1", "access_key": None, "secret_key": None}
    client = Bucket(URL, SimpleNamespace(**given, token=None, signature_version=None, retries=2))._client
    config = client.meta.config
    assert (client.meta.endpoint_url, client.meta.region_name) == ("http://127.0.0.1:9", "eu-west-1")
    assert (config.connect_timeout, config.request_checksum_calculation) == (10, "when_required")
    assert config.retries["total_max_attempts"] == 3


def test_a_missing_file_is_no_matter_of_credentials(bucket):
    for ask in (lambda: bucket.read("results/x"), lambda: bucket.fetch({"results/x": Path("results/x")})):
        with pytest.raises(FiptError, match=r"a file is missing in s3://rooms/lab \(.*\); run again"):
            ask()
    with pytest.raises(ValueError, match="of something else"), bucket.readable():
        raise ValueError("of something else")


def test_what_is_wrong_is_one_line(bucket, monkeypatch):
    with pytest.raises(FiptError, match="there is no bucket 'nobodys'; make it, or correct the URL"):
        Bucket("s3://nobodys").check()
    monkeypatch.setenv("AWS_PROFILE", "nobody")
    with pytest.raises(FiptError, match="there are no credentials for s3://rooms"):
        Bucket("s3://rooms").check()
    monkeypatch.delenv("AWS_PROFILE")
    monkeypatch.setenv("AWS_ENDPOINT_URL", "nonsense")
    with pytest.raises(FiptError, match=r"s3://rooms cannot be used \(Invalid endpoint: nonsense\)"):
        Bucket("s3://rooms")
