"""What Prometheus reads is what the run says."""

import dataclasses

from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics
from prometheus_client.parser import text_string_to_metric_families

from hsslam_services.health.prometheus import exposition
from tests.services.health.sample_snapshot import LATENCIES_MS, snapshot


def _read(body: bytes) -> dict[tuple[str, ...], float]:
    families = text_string_to_metric_families(body.decode())
    return {
        (sample.name, *sample.labels.values()): sample.value
        for family in families
        for sample in family.samples
    }


def test_every_number_arrives():
    body, content_type = exposition(snapshot({"mesher": "waiting"}))
    assert content_type.startswith("text/plain")
    read = _read(body)
    for name, value in {
        "frames_sent_total": 100,
        "frames_tracked_total": 96,
        "frames_lost_total": 2,
        "frames_dropped_total": 2,
        "pose_rate_hertz": 29.9,
        "tracking_quality": 0.97,
        "map_version": 31,
        "map_iterations_total": 420,
        "ba_rounds_total": 4,
        "memory_bytes": 900e6,
        "requests_refused_total": 1,
    }.items():
        assert read[f"hsslam_{name}",] == value
    assert read["hsslam_messages_rejected_total", "in/frame"] == 3
    assert read["hsslam_messages_dropped_total", "tracker", "in/frame"] == 2
    assert read["hsslam_process_restarts_total", "mapper"] == 1
    assert read["hsslam_process_restarts_total", "tracker"] == 0
    assert read["hsslam_process_up", "mesher"] == 0
    assert read["hsslam_process_up", "tracker"] == 1
    assert read["hsslam_process_memory_bytes", "tracker"] == 250e6
    assert read["hsslam_stage_seconds", "tracker", "align"] == 0.008
    assert read["hsslam_state", "running"] == 1
    assert read["hsslam_state", "paused"] == 0
    assert any('tum:a "quoted" name' in key for key in read)


def test_the_age_of_the_last_pose_arrives_as_soon_as_there_is_one():
    aged = dataclasses.replace(snapshot(), pose_age_s=7200.0)
    assert _read(exposition(aged)[0])["hsslam_pose_age_seconds",] == 7200.0
    assert ("hsslam_pose_age_seconds",) not in _read(exposition(snapshot())[0])


def test_latencies_are_a_histogram_in_seconds():
    read = _read(exposition(snapshot())[0])
    assert read["hsslam_latency_seconds_bucket", "0.005"] == 2  # a bound is part of its bucket
    assert read["hsslam_latency_seconds_bucket", "0.015"] == 3
    assert read["hsslam_latency_seconds_bucket", "1.0"] == 3
    assert read["hsslam_latency_seconds_bucket", "+Inf"] == len(LATENCIES_MS)
    assert read["hsslam_latency_seconds_count",] == len(LATENCIES_MS)
    assert read["hsslam_latency_seconds_sum",] == sum(LATENCIES_MS) / 1e3


def test_openmetrics_for_whom_asks_and_nothing_before_the_start():
    body, content_type = exposition(snapshot(), "application/openmetrics-text; version=1.0.0")
    assert content_type.startswith("application/openmetrics-text")
    assert "hsslam_frames_tracked" in {family.name for family in openmetrics(body.decode())}
    assert _read(exposition(None)[0]) == {}
