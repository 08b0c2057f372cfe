"""A certificate that ends soon is reported, once a day."""

import datetime
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from hsslam_services.commands.certs import make_certificates
from hsslam_services.security.certificate_validity import CertificateValidity, CertificateWarnings
from hsslam_services.security.credentials import Credentials

_NOW = datetime.datetime(2026, 5, 1, tzinfo=datetime.UTC)
_DAY = datetime.timedelta(days=1)


def test_a_folder_knows_when_it_ends(tmp_path):
    make_certificates(tmp_path / "c", (), 20)
    validity = Credentials.read(tmp_path / "c" / "router").validity
    assert 19.9 < validity.days_left(datetime.datetime.now(datetime.UTC)) <= 20


@given(st.floats(0.0, 400.0))
def test_it_warns_in_the_last_14_days_and_not_before(days):
    validity = CertificateValidity(Path("certs"), _NOW, _NOW + days * _DAY)
    assert bool(validity.warning(_NOW)) == (validity.ends - _NOW <= 14 * _DAY)


def test_the_warning_comes_once_a_day_and_at_the_end():
    warnings = CertificateWarnings(CertificateValidity(Path("certs"), _NOW, _NOW + 3 * _DAY))
    assert "ends on 2026-05-04 00:00 UTC, in 3 days" in warnings.take(_NOW)
    assert warnings.take(_NOW + 0.9 * _DAY) == ""
    assert "in 2 days" in warnings.take(_NOW + _DAY)
    assert "in 6.0 hours" in warnings.take(_NOW + 2.75 * _DAY)
    assert warnings.take(_NOW + 2.99 * _DAY) == ""
    assert "has ended on 2026-05-04 00:00 UTC: hsslam-certs DIR" in warnings.take(_NOW + 3 * _DAY)
    assert warnings.take(_NOW + 3.9 * _DAY) == ""
    assert "has ended" in warnings.take(_NOW + 4 * _DAY)
    assert CertificateWarnings(None).take(_NOW) == ""


def test_one_that_is_not_valid_yet_is_told_with_the_clock_of_this_machine():
    validity = CertificateValidity(Path("certs"), _NOW, _NOW + 90 * _DAY)
    said = "not valid before 2026-05-01 00:00 UTC, but it is 2026-04-30 00:00 UTC"
    assert said in validity.warning(_NOW - _DAY)
    assert validity.warning(_NOW) == ""
