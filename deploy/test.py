"""The steps of deploy/test.sh that run in a container of their own: test.py STEP [SERVER]."""
import json
import math
import sys
import time
import urllib.parse
import urllib.request
from pathlib import Path

from vrdp import Client, VrdpError
from vrdp.v1 import videos_pb2

SERVER = "vrdp:50051"
PROMETHEUS = "http://prometheus:9090/api/v1/query?"
DASHBOARD = Path("/deploy/grafana/dashboards/vrdp.json")
#: Longest wait (s): Prometheus needs two readings of each metric, 10 s apart.
PATIENCE = 90.0
QUESTION = "Will the red object hit the blue object?"


def post(client: Client, place: float = 2.0) -> str:
    rows = [{"id": 1, "frame": f, "x": f / 25, "y": 0.0, "color": "red"} for f in range(30)]
    rows += [{"id": 2, "frame": f, "x": place, "y": 0.0, "color": "blue"} for f in range(30)]
    return client.post(rows, name="deployed")


def kept(client: Client) -> list[str]:
    return [v.display_name for v in client._one(client._videos.ListVideos, videos_pb2.ListVideosRequest()).videos]


def asked(client: Client) -> None:
    answer = client.ask(post(client), QUESTION)
    assert answer.text == "yes", answer
    print(answer.explanation)


def first() -> None:
    with Client(SERVER, timeout=30) as client:
        assert kept(client) == []
        asked(client)


def again() -> None:
    with Client(SERVER, timeout=30) as client:
        assert kept(client) == ["deployed"], kept(client)
        asked(client)


def tls() -> None:
    """With the authority and a token; what the nobody of before had is not there for a tenant."""
    ca = Path("/tls/ca.pem").read_bytes()
    token = Path("/tls/tokens").read_text().partition(" ")[0]
    with Client(f"https://{SERVER}", ca=ca, token=token, timeout=30) as client:
        assert kept(client) == [], kept(client)
        asked(client)
    for client, expected in [(Client(SERVER, ca=ca), "UNAUTHENTICATED"), (Client(SERVER), "UNAVAILABLE")]:
        try:
            with client:
                raise AssertionError(f"got in: {kept(client)}")
        except VrdpError as refused:
            assert refused.code.name == expected, refused


def dashboard() -> None:
    """Every query of every panel gives a number, while calls are made."""
    panels = [p for p in json.loads(DASHBOARD.read_text())["panels"] if p["type"] != "row"]
    missing = {(p["title"], t["expr"].replace("$__rate_interval", "1m")) for p in panels for t in p["targets"]}
    count, end = len(missing), time.monotonic() + PATIENCE
    with Client(SERVER, timeout=30) as client:
        place = 2.0
        while missing and time.monotonic() < end:
            place += 1e-3
            video = post(client, place)
            client.ask(video, QUESTION)
            try:
                client.simulate(video, remove=[7])
                raise AssertionError("removed what is not there")
            except VrdpError:
                pass
            missing = {(title, query) for title, query in missing if not numbers(query)}
            time.sleep(1)
    assert not missing, missing
    print(f"{len(panels)} panels, {count} queries: all give numbers")


def numbers(query: str) -> list[float]:
    with urllib.request.urlopen(PROMETHEUS + urllib.parse.urlencode({"query": query}), timeout=10) as reply:
        found = json.load(reply)["data"]["result"]
    return [v for v in (float(one["value"][1]) for one in found) if math.isfinite(v)]


{f.__name__: f for f in (first, again, tls, dashboard)}[sys.argv[1]]()
