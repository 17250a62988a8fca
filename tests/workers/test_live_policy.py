"""Choice of the next frame: the newest, at most two in progress, none queued; video codecs decode every frame."""

from __future__ import annotations

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from workers.live import policy as module
from workers.live.model import Packet
from workers.live.policy import FramePolicy, StageStart


def packet(number: int, key: bool = True, size: int = 1) -> Packet:
    return Packet(number, 0, (64, 64), key, bytes(size), number / 30)


def begin(policy: FramePolicy) -> StageStart:
    start = policy.start()
    assert start is not None
    return start


def test_a_frame_passes_all_stages() -> None:
    policy = FramePolicy()
    assert policy.idle
    policy.arrive(packet(1))
    start = begin(policy)
    assert start.frame.sequence == 1
    policy.analyzed(start)
    policy.painted()
    assert not policy.idle
    policy.sent()
    assert policy.idle
    assert (policy.received, policy.dropped) == (1, 0)


def test_the_newest_frame_waits_and_older_frames_are_dropped() -> None:
    policy = FramePolicy(alone=False)
    policy.arrive(packet(1))
    start = begin(policy)
    for number in (2, 3, 4):
        policy.arrive(packet(number))
    assert policy.dropped == 2
    policy.analyzed(start)
    assert [p.sequence for p in begin(policy).packets] == [4]


def test_an_analysis_overlaps_at_most_one_painting() -> None:
    policy = FramePolicy(alone=False)
    policy.arrive(packet(1))
    first = begin(policy)
    policy.arrive(packet(2))
    assert policy.start() is None, "one is being analyzed"
    policy.analyzed(first)
    second = begin(policy)
    policy.analyzed(second)
    policy.arrive(packet(3))
    assert policy.start() is None, "two are in work"
    policy.painted()
    assert policy.start() is None, "an answer waits to be sent"
    policy.sent()
    assert begin(policy).frame.sequence == 3


def test_without_overlap_a_frame_begins_after_the_previous_one_is_sent() -> None:
    policy = FramePolicy()
    policy.arrive(packet(1))
    first = begin(policy)
    policy.arrive(packet(2))
    policy.analyzed(first)
    assert policy.start() is None, "it would take time from the first"
    policy.painted()
    policy.sent()
    assert begin(policy).frame.sequence == 2


def test_dropped_frames_of_a_video_codec_are_still_decoded() -> None:
    policy = FramePolicy(alone=False, built_on=True)
    policy.arrive(packet(1))
    start = begin(policy)
    for number in (2, 3):
        policy.arrive(packet(number, key=False))
    policy.analyzed(start)
    assert [p.sequence for p in begin(policy).packets] == [2, 3]
    assert policy.dropped == 1


def test_a_decoding_backlog_is_dropped_up_to_the_next_key_frame() -> None:
    for size, count in ((1, module.MAX_BUILT_ON + 1), (module.MAX_BUILT_ON_BYTES // 4, 5)):
        policy = FramePolicy(built_on=True)
        policy.arrive(packet(0))
        begin(policy)
        asked = [policy.arrive(packet(n, key=False, size=size)) for n in range(1, count + 3)]
        assert asked.count(True) == 1, "asked for once"
        assert policy.dropped == count + 2
        assert not policy.arrive(packet(1000))
        policy.painted()
        policy.sent()
        assert [p.sequence for p in begin(policy).packets] == [1000]


def test_a_missing_first_key_frame_is_requested_once() -> None:
    policy = FramePolicy(built_on=True)
    assert [policy.arrive(packet(n, key=False)) for n in range(3)] == [True, False, False]
    assert policy.start() is None


def test_a_worker_death_drops_frames_in_work_and_keeps_waiting_frames() -> None:
    policy = FramePolicy(alone=False)
    policy.arrive(packet(1))
    first = begin(policy)
    policy.analyzed(first)
    policy.arrive(packet(2))
    second = begin(policy)
    policy.arrive(packet(3))
    assert not policy.lost()
    assert policy.dropped == 2
    policy.analyzed(second)  # the word of the dead comes late
    assert begin(policy).frame.sequence == 3


def test_a_worker_death_under_a_video_codec_needs_a_key_frame() -> None:
    policy = FramePolicy(built_on=True)
    policy.arrive(packet(1))
    policy.arrive(packet(2, key=False))
    assert not policy.lost(), "what waits begins with a key frame"
    start = begin(policy)
    policy.arrive(packet(3, key=False))
    assert start.frame.sequence == 2
    assert policy.lost()
    assert not policy.arrive(packet(4, key=False)), "it has been asked for"
    assert policy.start() is None


def test_no_frame_begins_while_suspended() -> None:
    policy = FramePolicy(suspended=True)
    policy.arrive(packet(1))
    assert policy.start() is None
    policy.suspended = False
    assert policy.start()


def test_no_frame_is_left_after_the_client_disconnects() -> None:
    policy = FramePolicy()
    policy.arrive(packet(1))
    begin(policy)
    policy.painted()
    policy.arrive(packet(2))
    policy.leave()
    assert policy.idle
    assert policy.dropped == 2


EVENTS = st.lists(st.sampled_from(["key", "delta", "analyzed", "painted", "sent", "lost"]), max_size=120)


@given(EVENTS, st.booleans(), st.booleans())
def test_policy_invariants_hold_for_random_event_sequences(events: list[str], built_on: bool, alone: bool) -> None:
    policy = FramePolicy(built_on=built_on, alone=alone)
    in_work: deque[StageStart] = deque()
    analyzing: StageStart | None = None
    painted = number = decoded = 0
    for event in events:
        if event in ("key", "delta"):
            number += 1
            policy.arrive(packet(number, event == "key"))
        elif event == "analyzed" and analyzing:
            policy.analyzed(analyzing)
            analyzing = None
        elif event == "painted" and in_work and in_work[0] is not analyzing:
            in_work.popleft()
            policy.painted()
            painted += 1
        elif event == "sent" and policy.unsent:
            policy.sent()
        elif event == "lost":
            policy.lost()
            in_work.clear()
            analyzing, decoded = None, -1
        if start := policy.start():
            assert analyzing is None
            assert not policy.unsent
            check_decodable(start, built_on, decoded)
            decoded = start.frame.sequence
            analyzing = start
            in_work.append(start)
        assert len(in_work) <= (1 if alone else 2)
        assert policy.working == len(in_work)
        assert policy.received == number == painted + policy.dropped + policy.pending
        assert 0 <= policy.pending - policy.working <= 1


def check_decodable(start: StageStart, built_on: bool, decoded: int) -> None:
    """Check that frame numbers rise and that a video codec's frames are key frames or follow the last decoded one."""
    numbers = [p.sequence for p in start.packets]
    assert numbers == sorted(numbers)
    assert numbers[0] > decoded
    if not built_on:
        assert len(numbers) == 1
        return
    before = decoded
    for one in start.packets:
        assert one.key or one.sequence == before + 1
        before = one.sequence
