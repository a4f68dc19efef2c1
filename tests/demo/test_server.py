"""The running demo by plain HTTP: what gradio's settings refuse, and visitors apart from each other."""

import json
from concurrent.futures import ThreadPoolExecutor

import pytest

pytest.importorskip("gradio")
import app as serve

pytestmark = pytest.mark.slow


def test_files_of_the_server_are_not_served_and_large_uploads_refused(server, visitor_at):
    visitor = visitor_at(server)
    assert b"Tactile textures" in visitor.ask("GET", "/")[1]
    for path in ("/etc/passwd", "../../etc/passwd", "..%2f..%2fetc%2fpasswd", __file__):
        status, body = visitor.ask("GET", f"/gradio_api/file={path}")
        assert status in (403, 404) and b"root:" not in body
    assert visitor.upload("a.csv", bytes((serve.UPLOAD_MIB + 1) * 2**20))[0] == 413


def test_a_path_of_the_server_is_no_upload(server, tmp_path, visitor_at):
    (tmp_path / "secret.csv").write_bytes(b"0.1\n-0.1\n0.2\n" * 2000)
    asked = {"path": str(tmp_path / "secret.csv"), "meta": {"_type": "gradio.FileData"}}
    assert not visitor_at(server).call("from_file", [asked, None, 10_000, 1])[0]


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("live", 3, 150),
        ("live", 3, "50"),
        ("live", 10, 2**40),
        ("live", 12, 9000),
        ("live", 14, "../x"),
        ("download", 2, "x"),
    ],
)
def test_more_than_the_page_offers_is_refused(server, name, place, value, visitor_at):
    visitor = visitor_at(server)
    values = list(visitor.values[name])
    values[place] = value
    success, output = visitor.call(name, values)
    told = json.dumps(output)
    assert (not success or "must be" in told) and "root:" not in told


def test_visitors_at_once_get_what_each_would_get_alone(server, visitor_at):
    visitors = [visitor_at(server) for _ in range(4)]
    alone = [visitor.move(20 * number)["tracks"][0] for number, visitor in enumerate(visitors)]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda asked: asked[1].move(20 * asked[0])["tracks"][0], enumerate(visitors)))
    levels = [one["level"] for one in alone]
    assert len(set(levels)) == 4
    assert [one["level"] for one in together] == pytest.approx(levels, rel=1e-4)
