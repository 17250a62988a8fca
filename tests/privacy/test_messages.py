"""Errors name their cause, and quote nothing private."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.errors import UnreadableMedia
from pipeline.video.guard.decoder_process import DecoderNotStarted
from pipeline.video.probe import probe
from service.errors import problem
from workers.blobs.keys import NoBlob
from workers.contract.record import asset_key
from workers.faults import fault_from, is_resource_away


def test_the_text_of_a_file_that_is_no_media_is_not_quoted(tmp_path: Path) -> None:
    secret, link = tmp_path / "passwd", tmp_path / "film.mp4"
    secret.write_text("root:x:0:0:root:/root:/bin/bash\n")
    link.symlink_to(secret)
    with pytest.raises(UnreadableMedia) as refused:
        probe(link)
    assert "root" not in f"{refused.value.message}{refused.value.value}{refused.value.remedy}"


def test_a_job_whose_source_is_gone_names_the_asset_and_the_remedy() -> None:
    asset = f"ast_{'a' * 64}"
    fault = fault_from(NoBlob(asset_key(asset)))
    assert (fault.code, fault.value) == ("not-found", asset)
    assert "Upload the file again" in fault.remedy and "bytes of an input are gone" in fault.message


def test_a_decoder_that_cannot_start_is_a_shortage_of_the_machine() -> None:
    error = DecoderNotStarted("No decoder could be started.", remedy="Raise the limits.")
    assert problem(error, "/v1/assets").status == 503
    assert is_resource_away(fault_from(error)), "no attempt is charged"


def test_files_are_read_under_a_limit_of_address_space(tiny_clip: Path) -> None:
    """`ulimit -v`, whose hard limit a decoder process cannot raise."""
    script = """import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))
from pipeline.video.media import Limits
from pipeline.video.probe import probe_guarded
print(probe_guarded(Path(sys.argv[1]), Limits()).frames)"""
    done = subprocess.run([sys.executable, "-c", script, str(tiny_clip)], capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "24", done.stderr
