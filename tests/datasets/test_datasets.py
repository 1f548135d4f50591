"""Free data sets: definitions, downloads from a faulty server, hostile archives."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import sys
import time
import zipfile
from collections.abc import Callable
from contextlib import nullcontext
from email.utils import formatdate
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from db_cli import run, write_clip
from http_server import Site, serve
from platforms import on_wine
from windows_files import as_on_windows

from priorfill.datasets import (
    Dataset,
    DatasetFile,
    FetchOptions,
    RetryPolicy,
    fetch,
    find_dataset,
    known_datasets,
    local_names,
)
from priorfill.datasets.download import Downloader
from priorfill.datasets.fetch_dataset import RECORD
from priorfill.datasets.retry_policy import FileFetchError
from priorfill.datasets.unpack import unpack
from priorfill.errors import FetchError, OptionError
from priorfill.markers.definitions import load

CONTENT = bytes(range(256)) * 4000
QUICK = RetryPolicy(pause=0, timeout=0.3, max_attempts=4, wait=0.5, max_wait=60)


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("no_proxy", "127.0.0.1")


class Getter:
    """Downloads ``f`` of a site into a folder, and records its waits, messages and progress."""

    def __init__(self, site: Site, folder: Path) -> None:
        self.site, self.target = site, folder / "f"
        self.waited: list[float] = []
        self.messages: list[str] = []
        self.progress: list[tuple[int, int | None]] = []

    def __call__(self, **options: Any) -> str:
        with Downloader(QUICK, self.messages.append, self.waited.append) as downloader:
            return downloader.get(
                f"{self.site.url}/f",
                self.target,
                progress=lambda done, total: self.progress.append((done, total)),
                **options,
            )

    @property
    def ranges(self) -> list[str]:
        return [request.get("Range", "") for request in self.site.requests]

    def assert_complete(self, content: bytes = CONTENT) -> None:
        assert self.target.read_bytes() == content
        assert [path.name for path in self.target.parent.iterdir()] == ["f"]


def test_a_download(tmp_path):
    with serve({"f": CONTENT}) as site:
        get = Getter(site, tmp_path)
        assert get(size=len(CONTENT)) == hashlib.sha256(CONTENT).hexdigest()
        get.assert_complete()
        assert get.waited == []
        assert get.progress[0] == (0, len(CONTENT))
        assert get.progress[-1] == (len(CONTENT), len(CONTENT))
        assert site.requests[0]["User-Agent"].startswith("priorfill/")


def test_a_broken_connection_is_resumed(tmp_path):
    with serve({"f": CONTENT}) as site:
        site.behave.extend([("cut", 100_000), ("cut", 5), ("cut", 300_000)])
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.ranges == ["", "bytes=100000-", "bytes=100005-", "bytes=400005-"]
        assert get.waited == [0.5, 1.0, 0.5]  # the second brought almost nothing
        assert "broke after 100005 of 1024000 bytes; trying again in 1 s" in get.messages[0]


@pytest.mark.windows
def test_a_second_run_resumes_an_interrupted_one(tmp_path):
    with serve({"f": CONTENT}) as site:
        get = Getter(site, tmp_path)

        def interrupt(done: int, total: int | None) -> None:
            if done > 0:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt), Downloader(QUICK) as downloader:
            downloader.get(f"{site.url}/f", get.target, progress=interrupt)
        there = (tmp_path / "f.part").stat().st_size
        assert 0 < there < len(CONTENT)
        assert not get.target.exists()
        get()
        get.assert_complete()
        assert get.ranges == ["", f"bytes={there}-"]


@pytest.mark.windows
def test_a_part_that_another_program_has_open_is_kept(tmp_path):
    part = tmp_path / "f.part"
    part.touch()
    held = nullcontext() if sys.platform == "win32" else as_on_windows()
    with serve({"f": CONTENT}) as site, held:
        get = Getter(site, tmp_path)
        with part.open("rb"), pytest.raises(FetchError, match=r"f\.part: is complete, but open in"):
            get()
        assert part.read_bytes() == CONTENT
        get()
        get.assert_complete()
        assert len(site.requests) == 1


def test_a_server_without_ranges_sends_the_complete_file_again(tmp_path):
    with serve({"f": CONTENT}, ranges=False) as site:
        site.behave.append(("cut", 100_000))
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.ranges == ["", "bytes=100000-"]


def test_without_a_validator_the_download_starts_again(tmp_path):
    with serve({"f": CONTENT}, tags=False) as site:
        site.behave.append(("cut", 100_000))
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.ranges == ["", ""]
        # unless the checksum is known, which would reveal a wrong rest
        site.behave.append(("cut", 100_000))
        get.target.unlink()
        get(sha256=hashlib.sha256(CONTENT).hexdigest())
        get.assert_complete()
        assert get.ranges[2:] == ["", "bytes=100000-"]


@pytest.mark.parametrize("new", [CONTENT[::-1], CONTENT[::-1][:90_000], CONTENT * 2])
@pytest.mark.parametrize("tags", [True, False])
def test_a_file_that_changes_during_the_download_arrives_as_the_new_one(tmp_path, new, tags):
    with serve({"f": CONTENT}, tags=tags) as site:
        site.behave.extend([("cut", 100_000), ("call", lambda: site.files.update(f=new))])
        get = Getter(site, tmp_path)
        get(sha256="" if tags else hashlib.sha256(new).hexdigest())
        get.assert_complete(new)


def test_a_file_of_unknown_length(tmp_path):
    with serve({"f": CONTENT}, length=False) as site:
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.progress[-1] == (len(CONTENT), None)


def test_a_busy_server_is_asked_again_after_a_bounded_wait(tmp_path):
    later = formatdate(time.time() + 20, usegmt=True)
    with serve({"f": CONTENT}) as site:
        for header in ({"Retry-After": "7"}, {"Retry-After": later}, {}):
            site.behave.append(("status", 503, header))
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.waited[0] == 7
        assert 15 < get.waited[1] <= 20
        assert get.waited[2] == 2.0
        assert "answers 503 Service Unavailable; trying again in 7 s" in get.messages[0]
        get.target.unlink()
        site.behave.append(("status", 429, {"Retry-After": "3600"}))
        with pytest.raises(FetchError, match="asks to wait 3600 s"):
            get()


def test_a_stalled_server_is_asked_again_and_given_up(tmp_path):
    with serve({"f": CONTENT}) as site:
        site.behave.append(("stall", 100_000))
        get = Getter(site, tmp_path)
        get()
        get.assert_complete()
        assert get.ranges[1] == "bytes=100000-"
        get.target.unlink()
        site.behave.extend([("stall", 10)] * 4)
        with pytest.raises(FetchError, match=r"timed out\) \(4 times\); the received part is kept"):
            get()
        assert (tmp_path / "f.part").stat().st_size == 40


@pytest.mark.parametrize(
    ("status", "error", "words"),
    [
        (404, FileFetchError, "404 Not Found; the file does not exist"),
        (403, FetchError, "403 Forbidden; download it with a browser, save it as .*f, and"),
        (418, FileFetchError, "418"),
        (302, FetchError, "redirects to ftp://host/f, which is not followed"),
    ],
)
def test_errors_that_are_not_retried(tmp_path, status, error, words):
    with serve({"f": CONTENT}) as site:
        site.behave.append(("status", status, {"Location": "ftp://host/f"}))
        get = Getter(site, tmp_path)
        with pytest.raises(error, match=words) as raised:
            get()
        assert "\n" not in str(raised.value)
        assert len(site.requests) == 1
        assert list(tmp_path.iterdir()) == []


def test_no_server(tmp_path):
    with serve({}) as site:
        get = Getter(site, tmp_path)
    with pytest.raises(FetchError, match=r"connection failed \(Connection refused\) \(4 times\)"):
        get()
    assert get.waited == [0.5, 1.0, 2.0]


def test_a_wrong_checksum_or_length(tmp_path):
    with serve({"f": CONTENT}) as site:
        get = Getter(site, tmp_path)
        with pytest.raises(FileFetchError, match=r"its checksum is not 0000"):
            get(sha256="0" * 64)
        with pytest.raises(FileFetchError, match="has 1024000 bytes, not 17"):
            get(size=17)
        assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_noticed_before_the_download(tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: type("", (), {"free": 100_500_000}))
    with serve({"f": CONTENT}) as site, pytest.raises(FetchError, match="free some space"):
        Getter(site, tmp_path)()


# archives


def archive(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as made:
        for name, content in members.items():
            made.writestr(name, content)
    return path


@pytest.mark.windows
def test_only_recordings_are_unpacked(tmp_path):
    made = archive(
        tmp_path / "a.zip",
        {
            "s/01/walk.C3D": b"1",
            "s/run.c3d": b"22",
            "s/readme.txt": b"",
            "__MACOSX/s/._run.c3d": b"",
        },
    )
    to = tmp_path / "to"
    to.mkdir()
    assert unpack(made, to) == [to / "s/01/walk.C3D", to / "s/run.c3d"]
    assert [p.read_bytes() for p in unpack(made, to)] == [b"1", b"22"]
    assert sorted(p.name for p in to.rglob("*") if p.is_file()) == ["run.c3d", "walk.C3D"]
    before = (to / "s/run.c3d").stat().st_mtime_ns
    (to / "s/01/walk.C3D").write_bytes(b"2")
    unpack(made, to)
    assert (to / "s/01/walk.C3D").read_bytes() == b"1"
    assert (to / "s/run.c3d").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../out.c3d", "leads out"),
        ("/etc/out.c3d", "leads out"),
        ("a/../../out.c3d", "leads out"),
        ("C:/out.c3d", "leads out"),
        ("c:out.c3d", "leads out"),
        ("a\\..\\..\\out.c3d", "leads out"),
        ("\\\\server\\share\\out.c3d", "leads out"),
        ("RUN.c3d", r"two recordings of one name \('run.c3d' and 'RUN.c3d'\)"),
        ("./run.c3d", "two recordings of one name"),
        ("run.c3d/out.c3d", "in another one"),
        ("a\x01.c3d", "control characters"),
        (f"{'x' * 252}.c3d", "name of 256 bytes"),
    ],
)
@pytest.mark.parametrize("windows", [False, True])
def test_names_that_are_refused(tmp_path, name, words, windows, monkeypatch):
    monkeypatch.setattr(local_names, "WINDOWS", windows)
    made = archive(tmp_path / "a.zip", {"run.c3d": b"1", name: b"2"})
    to = tmp_path / "to"
    to.mkdir()
    with pytest.raises(FileFetchError, match=words):
        unpack(made, to)
    assert list(to.iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zip", "to"]


@pytest.mark.skipif(on_wine(), reason="wine makes no symbolic link to a folder")
def test_links_that_lead_out_of_the_folder(tmp_path):
    made = archive(tmp_path / "a.zip", {"run.c3d": b"1", "link/out.c3d": b"2"})
    to = tmp_path / "to"
    to.mkdir()
    try:
        (to / "link").symlink_to(tmp_path)
    except OSError:
        pytest.skip("Windows gives the right to make symbolic links to few")
    with pytest.raises(FileFetchError, match="leads out"):
        unpack(made, to)
    assert [path.name for path in to.iterdir()] == ["link"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.zip", "to"]


ODD_NAMES = {
    "aux.c3d": "aux_.c3d",
    "s/Com1 .x.c3d": "s/Com1_.x.c3d",
    "take 1: a?.c3d": "take 1_ a_.c3d",
    "trail. ./a.c3d": "trail___/a.c3d",
    "trail/a.c3d": "trail/a.c3d",
    "walk\\é膝.c3d": "walk/é膝.c3d",
}
"""Names of recordings in an archive, and those that Windows allows."""


@pytest.mark.windows
def test_names_that_windows_does_not_allow(tmp_path, monkeypatch):
    monkeypatch.setattr(local_names, "WINDOWS", True)
    made = archive(tmp_path / "a.zip", {name: name.encode() for name in ODD_NAMES})
    notes: list[str] = []
    for _ in range(2):  # the second time, all is there
        paths = unpack(made, tmp_path / "to", notify=notes.append)
        assert [path.relative_to(tmp_path / "to").as_posix() for path in paths] == [
            *ODD_NAMES.values()
        ]
        for name, path in zip(ODD_NAMES, paths, strict=True):
            assert path.read_bytes().decode().replace("/", "\\") == name.replace("/", "\\")
        assert sum(path.is_file() for path in (tmp_path / "to").rglob("*")) == len(ODD_NAMES)
    note = "not allow all its names; unpacks 'aux.c3d' as 'aux_.c3d' and 3 others"
    assert [note in text for text in notes] == [True, True]
    archive(made, {"aa:b.c3d": b"1", "aa_b.c3d": b"2"})
    with pytest.raises(FileFetchError, match="two recordings of one name"):
        unpack(made, tmp_path / "to")


def test_other_systems_keep_names(tmp_path, monkeypatch):
    monkeypatch.setattr(local_names, "WINDOWS", False)
    kept = [name.replace("\\", "/") for name in ODD_NAMES]
    assert [local_names.local_path(name).as_posix() for name in ODD_NAMES] == kept


def test_archives_that_are_damaged_too_large_or_state_wrong_sizes(tmp_path, monkeypatch):
    to = tmp_path / "to"
    to.mkdir()
    path = archive(tmp_path / "a.zip", {"a.c3d": bytes(100_000), "é.txt": b""})
    whole = path.read_bytes()
    monkeypatch.setattr("priorfill.datasets.unpack.MAX_RECORDING_BYTES", 99_999)
    with pytest.raises(FileFetchError, match="recording of"):
        unpack(path, to)
    monkeypatch.setattr("priorfill.datasets.unpack.MAX_RECORDING_BYTES", 1 << 30)
    size = whole.rindex((100_000).to_bytes(4, "little"))
    for spoil, words in (
        (lambda c: c[:size] + (2**29).to_bytes(4, "little") + c[size + 4 :], "impossible size"),
        (lambda c: c[:size] + (50_000).to_bytes(4, "little") + c[size + 4 :], "Bad CRC"),
        (lambda c: c[:-30], "no zip file"),
        (lambda c: b"<html>please log in</html>", "no zip file"),
        (lambda c: c[:45] + b"\xff" * 20 + c[65:], "remove it and try again"),
        (lambda c: c.replace("é".encode(), b"\xff\xff"), "cannot be unpacked .*'utf-8' codec"),
    ):
        path.write_bytes(spoil(whole))
        with pytest.raises(FileFetchError, match=words):
            unpack(path, to)
        assert list(to.iterdir()) == []
    with pytest.raises(FileFetchError, match=r"has no recordings \(.c3d\)"):
        unpack(archive(path, {"readme.txt": b""}), to)


# definitions


def test_the_data_sets_shipped_with_priorfill():
    datasets = {dataset.name: dataset for dataset in known_datasets()}
    assert list(datasets) == ["cmu", "hdm05"]
    assert datasets["hdm05"].subject("HDM_bd_05-01_01_120") == "hdm05-bd"
    assert datasets["cmu"].subject("127_07") == "cmu-127"
    assert datasets["cmu"].subject("walk") == ""
    for dataset in datasets.values():
        assert load(dataset.marker_set)
        assert len({file.path for file in dataset.files}) == len(dataset.files)
        assert dataset.licence
        assert dataset.credit


GOOD = (
    'name = "x"\ntitle = "X"\nhome = "h"\nbase = "http://x"\nlicence = "CC0"\nterms = "t"\n'
    'credit = "me"\nmarker_set = ""\n[[files]]\npath = "a.zip"\n'
)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("", "", ""),
        ('credit = "me"\n', "", "credit is None"),
        ("http://x", "ftp://x", "is not a web address"),
        ("a.zip", "../a.zip", "is not a relative path"),
        ("[[files]]", '[[files]]\npath = "A.zip"\n[[files]]', "one name on some systems"),
        ("[[files]]", "odd = 1\n[[files]]", "'odd' is unknown"),
        ('path = "a.zip"', 'path = "a.zip"\nsha256 = "12"', "64 hexadecimal"),
        ('path = "a.zip"', 'path = "a.zip"\nbytes = 0', "above 0"),
        ("[[files]]", 'subject = {pattern = "a", name = "{}"}\n[[files]]', "one group"),
        ("[[files]]", 'subject = {pattern = "(", name = "{}"}\n[[files]]', "is invalid"),
        ("[[files]]", 'subject = {pattern = "(?=a)", name = "{}"}\n[[files]]', "is invalid"),
        ("[[files]]", 'subject = {pattern = "((a{99}){99})", name = "{}"}\n[[files]]', "invalid"),
        ("name", "name name", "is not valid TOML"),
    ],
)
def test_definitions(tmp_path, old, new, words):
    path = tmp_path / "x.toml"
    path.write_text(GOOD.replace(old, new, 1) if old else GOOD, encoding="utf-8")
    if not words:
        assert find_dataset(str(path)).base == "http://x/"
        return
    with pytest.raises(FetchError, match=words):
        find_dataset(str(path))
    with pytest.raises(OptionError, match="use one of cmu, hdm05"):
        find_dataset("x")


def test_no_pattern_of_a_definition_takes_long(tmp_path, capfd):
    path = tmp_path / "x.toml"
    pattern = "((?:a+)+)$"  # Python tries 2 ** 40 divisions of the name
    path.write_text(f'{GOOD}[subject]\npattern = "{pattern}"\nname = "{{0.x}}-{{}}"', "utf-8")
    dataset = find_dataset(str(path))
    assert dataset.subject("a" * 40 + "b") == ""
    assert dataset.subject("aaa") == "{0.x}-aaa"
    assert dataset.subject("\udcff") == ""
    assert capfd.readouterr() == ("", "")


# folders


def make_dataset(*paths: str, **more: Any) -> Dataset:
    files = tuple(DatasetFile(path, **more) for path in paths)
    return Dataset("x", "X", "", "http://192.0.2.1/", "CC0", "", "me", "", "", "", files)


def zipped(**members: bytes) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as opened:
        for name, content in members.items():
            opened.writestr(f"{name}.c3d", content)
    return made.getvalue()


def test_a_folder_records_what_it_has(tmp_path):
    of = make_dataset("a.zip", "deep/b.zip")
    files = {"a.zip": zipped(a=b"1", b=b"2"), "deep/b.zip": zipped(c=b"3")}
    to = tmp_path / "to"
    with serve(files) as site:

        def get(**options: Any) -> list[tuple[str, bool, int, str]]:
            found = fetch(of, to, options=FetchOptions(mirror=site.url, policy=QUICK, **options))
            return [(f.file.path, f.new, len(f.recordings), f.failure) for f in found]

        assert get(limit=1) == [("a.zip", True, 2, "")]
        assert get(only=["b.*"]) == [("deep/b.zip", True, 1, "")]
        both = [("a.zip", False, 2, ""), ("deep/b.zip", False, 1, "")]
        assert get() == both
        (to / "a.zip").unlink()  # not needed once unpacked
        assert get() == both
        assert len(site.requests) == 2
        (to / "b.c3d").unlink()  # now the archive is needed
        site.files["a.zip"] = zipped(a=b"1", b=b"x")
        ((_, _, _, failure), _) = get()
        assert "its checksum is" in failure
        site.files["a.zip"] = files["a.zip"]
        assert get() == [("a.zip", True, 2, ""), both[1]]
        (to / "deep" / "b.zip").write_bytes(zipped(c=b"4"))
        assert "has changed since" in get()[1][3]
        with pytest.raises(
            OptionError, match=r"no file matches 'c\*'; its files are a.zip, deep/b"
        ):
            get(only=["c*"])
        with pytest.raises(OptionError, match="is not a web address"):
            list(fetch(of, to, FetchOptions(mirror="file:///")))
    for content in ("no JSON", '{"version": 1, "dataset": "x", "files": [1]}'):
        (to / RECORD).write_text(content, "utf-8")
        (to / "deep" / "b.zip").write_bytes(files["deep/b.zip"])
        assert [f.new for f in fetch(of, to)] == [False, False]
    (to / RECORD).write_text('{"version": 1, "dataset": "y", "files": {}}', "utf-8")
    with pytest.raises(FetchError, match="has files of the data set y"):
        list(fetch(of, to))


@pytest.mark.windows
def test_no_archive_replaces_the_recordings_of_another(tmp_path):
    of = make_dataset("a.zip", "b.zip", "get?c.zip")
    files = {"a.zip": zipped(x=b"1", y=b"2"), "b.zip": zipped(X=b"3"), "get?c.zip": zipped(y=b"2")}
    with serve(files) as site:
        options = FetchOptions(mirror=site.url, policy=QUICK)
        for _ in range(2):
            first, second, third = fetch(of, tmp_path, options)
            assert (first.failure, third.failure) == ("", "")
            assert "its recording 'X.c3d' would replace that of a.zip" in second.failure
    assert [path.read_bytes() for path in first.recordings] == [b"1", b"2"]
    assert third.recordings == (tmp_path / "y.c3d",)  # the same in both
    assert not (tmp_path / "b.c3d").exists()


@pytest.mark.windows
def test_a_server_whose_names_windows_does_not_allow(tmp_path, monkeypatch):
    monkeypatch.setattr(local_names, "WINDOWS", True)
    with serve({"get?aux.zip": zipped(a=b"1")}) as site:
        options = FetchOptions(mirror=site.url, policy=QUICK)
        (found,) = fetch(make_dataset("get?aux.zip"), tmp_path, options)
    assert (found.failure, found.path) == ("", tmp_path / "get_aux.zip")


@pytest.mark.windows
def test_one_download_at_a_time(tmp_path):
    with serve({"a.zip": zipped(a=b"1"), "b.zip": zipped(b=b"1")}) as site:
        options = FetchOptions(mirror=site.url, policy=QUICK)
        first = fetch(make_dataset("a.zip", "b.zip"), tmp_path, options)
        next(first)
        with pytest.raises(FetchError, match=rf"process {os.getpid()} on .* is downloading"):
            next(fetch(make_dataset("a.zip"), tmp_path, options))
        first.close()
        assert len(list(fetch(make_dataset("a.zip"), tmp_path, options))) == 1


# the command


@pytest.fixture
def hdm05(here: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], bytes]:
    """Make an archive of recordings with names as in HDM05."""
    monkeypatch.setattr("time.sleep", lambda seconds: None)

    def make(*names: str) -> bytes:
        return zipped(
            **{
                Path(name).stem: write_clip(here / "made" / f"{name}.c3d", seed).read_bytes()
                for seed, name in enumerate(names)
            }
        )

    return make


def test_the_command(here, hdm05):
    files = {
        "01-01/HDM_01-01_c3d.zip": hdm05("HDM_bd_01-01_01_120", "HDM_tr_01-01_02_120"),
        "01-02/HDM_01-02_c3d.zip": b"<html>",
    }
    with serve(files) as site:
        common = ["db", "fetch", "hdm05", "-d", "labs/db", "--mirror", site.url]
        result = run(*common, "--only", "*_01-0[123]_*")
        assert (result.exit_code, site.requests) == (1, [])  # the terms were not accepted
        assert "licence   CC BY-SA 3.0\n" in result.stderr
        assert "CG-2007-2" in result.stderr
        assert "files     3 of 20, from http://127" in result.stderr
        assert not Path("labs").exists()

        result = run(*common, "--only", "*_01-0[123]_*", "--yes")
        assert result.exit_code == 1
        lines = result.stdout.splitlines()
        folder = here / "labs" / "hdm05"
        made = re.escape(str(folder / "01-01" / "HDM_01-01_c3d.zip"))
        assert re.fullmatch(rf"downloaded {made} \(.* kB, 2 recordings\)", lines[0])
        assert lines[1] == f"2 recordings in {folder}, could not download 2"
        assert lines[-1] == "added 2 clips, 2.00 s of motion"
        assert "01-02_c3d.zip: is no zip file or damaged" in result.stderr
        assert "01-03_c3d.zip: the server answers 404" in result.stderr

        result = run(*common, "--only", "*01-01*", "--yes")
        assert result.exit_code == 0
        assert "there already: " in result.stdout
        last = result.stdout.splitlines()[-1]
        assert re.fullmatch(r"added 0 clips.*, skipped 2 that are there already", last)
    info = run("db", "info", "-d", "labs/db").stdout
    assert "subjects     2\n" in info
    assert "licence      CC BY-SA 3.0 (2)\n" in info
    assert "credit       HDM05: Müller" in info
    clips = json.loads(run("db", "list", "-d", "labs/db", "--json").stdout)
    assert {clip["subject"] for clip in clips} == {"hdm05-bd", "hdm05-tr"}


def test_the_list_and_missing_arguments(here):
    result = run("db", "fetch", "--list")
    assert result.exit_code == 0
    assert re.search(r"^hdm05  Mocap Database", result.stdout, re.MULTILINE)
    assert run("db", "fetch", "cmu").exit_code == 2
    assert run("db", "fetch", "cmu", "--download-only").exit_code == 2
    assert "use one of cmu, hdm05" in run("db", "fetch", "mine", "-d", "db", "-y").stderr


def test_only_fetch_uses_the_network(monkeypatch):
    """Imports and the list of data sets do not."""
    monkeypatch.setattr("socket.socket.connect", lambda *a: pytest.fail("the network is used"))
    assert known_datasets()
    assert import_module("priorfill.datasets.download")
