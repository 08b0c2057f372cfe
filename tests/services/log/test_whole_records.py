"""The walk over a file that another process finishes meanwhile."""

import numpy as np
import pytest

from hsslam_proto import topics
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.whole_records import Found, Gap, whole_records


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """An unfinished log of three chunks."""
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    writer, noise = McapLog(path, "r"), np.random.default_rng(0)
    for index in range(3):
        writer.write(topics.STEP, noise.bytes(200), 1, 1, index)
        writer._writer.flush()
    return path.read_bytes()


@pytest.mark.parametrize("lost_bytes", [1, 5, 9, 10, 400])
@pytest.mark.parametrize("more_bytes", [0, 1, 9, 2**23])
def test_a_file_that_becomes_shorter_has_an_end(log, tmp_path, lost_bytes, more_bytes):
    path = tmp_path / "run.mcap"
    size = len(log) + more_bytes
    path.write_bytes(log[:-lost_bytes])
    with path.open("rb") as stream:
        walked = list(whole_records(stream, size))
    found = [one for one in walked if isinstance(one, Found)]
    assert sum(len(one.content.messages) for one in found if one.content) >= 1
    assert isinstance(walked[-1], Gap) and walked[-1].end == size
