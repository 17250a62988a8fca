"""A few malformed files of every kind in every run of the suite; `make fuzz` makes many more."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fuzz import ledger, media
from tests.fuzz.samples import samples

MENDED = ("media:exr:1:2", "media:webm:7:9", "media:flv:7:10", "media:mkv:7:197")
"""Cases that revealed faults in the past."""


@pytest.mark.parametrize("kind", samples())
def test_well_formed_samples_are_decoded(kind: str, tmp_path: Path) -> None:
    for number in range(len(samples()[kind])):
        (tmp_path / "upload").write_bytes(data := samples()[kind][number])
        assert media.decode(kind, tmp_path / "upload", data) == "decoded"


@pytest.mark.parametrize("number", range(12))
def test_malformed_files_are_decoded_or_refused(number: int, tmp_path: Path) -> None:
    for case in media.cases(seed=0, number=number):
        assert not media.outcome(case, tmp_path).startswith("fault"), case.id


@pytest.mark.parametrize("name", MENDED)
def test_fixed_fuzz_cases_stay_fixed(name: str, tmp_path: Path) -> None:
    assert not media.outcome(media.Case.of(name), tmp_path).startswith("fault")


def test_a_fuzz_case_is_reproduced_from_its_id() -> None:
    case = media.Case("mp4", 3, 17)
    assert media.Case.of(case.id) == case and case.data() == media.Case("mp4", 3, 17).data()
    assert case.data() != media.Case("mp4", 4, 17).data()


def test_the_ledger_sums_its_runs(tmp_path: Path) -> None:
    file = tmp_path / "ledger.jsonl"
    for seed in (1, 2):
        run = ledger.Run("media", "2026-01-01", "abc", seed, 0)
        run.count("refused", 0.2)
        run.count("decoded", 0.4)
        ledger.append(run, file)
    assert [run.cases for run in ledger.runs(file)] == [2, 2]
    assert "| media | 2 | 4 | 0 | 0.4 |" in ledger.table(ledger.runs(file))


def test_a_tiff_with_tags_of_wrong_types_is_refused(tmp_path: Path) -> None:
    """Found by a run of the fuzzer: bits per sample as bytes instead of numbers."""
    assert media.outcome(media.Case("tiff", 31, 102), tmp_path).startswith("refused")
