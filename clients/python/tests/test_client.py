"""Against a running service, whose address is in VRDP_SERVER."""
import json
import math
import os
from pathlib import Path

import grpc
import pandas
import pytest

from vrdp import Client, VrdpError


@pytest.fixture
def client():
    with Client(os.environ["VRDP_SERVER"]) as client:
        yield client


def tracks() -> pandas.DataFrame:
    """A puck that glides towards one at rest and meets it after the video."""
    rows = [{"id": 1, "frame": f, "x": f / 25, "y": 0.0, "color": "red"} for f in range(30)]
    rows += [{"id": 2, "frame": f, "x": 2.0, "y": 0.0, "yaw": 0.1, "color": "blue"} for f in range(30)]
    return pandas.DataFrame(rows)


def test_tables_go_in_and_come_out(client):
    video = client.post(tracks(), name="two pucks")
    assert video == client.post(tracks(), name="two pucks")
    simulation = client.simulate(video)
    table = simulation.frame()
    assert list(table["frame"].unique()) == list(range(90))
    seen = table[(table["id"] == 1) & table["observed"]]
    assert abs(seen["x"].iloc[10] - 0.4) < 0.01
    assert any(e["kind"] == "collision" and e["object_ids"] == [1, 2] for e in simulation.events)
    assert not any(e["kind"] == "collision" for e in client.simulate(video, remove=[2]).events)
    assert client.trace(simulation.trace).startswith(b"\x89MCAP0\r\n")


def test_files_and_frames_are_read_by_the_same_rules(client, tmp_path):
    seconds = tracks().rename(columns={"frame": "t [ms]", "id": "puck", "x": "x [cm]", "y": "y [cm]"})
    seconds["t [ms]"] *= 40
    seconds["x [cm]"] *= 100
    seconds.loc[5, ["x [cm]", "y [cm]"]] = math.nan
    with pytest.warns(UserWarning, match="masses near 1 kg"):
        video = client.post(seconds, world="table", size=0.2)
    path = tmp_path / "tracks.csv"
    seconds.to_csv(path, index=False, sep=";", decimal=",", na_rep="NA")
    with pytest.warns(UserWarning, match="semicolons, decimal commas"):
        of_file = client.post(path, world="table", size=0.2)
    assert of_file == video
    with pytest.warns(UserWarning, match="25 frames per second"):
        client.post(tracks())
    with pytest.raises(VrdpError, match="give the scale"):
        client.post(tracks(), unit="px")
    with pytest.raises(VrdpError, match="to_csv"):
        client.post(b"\x89HDF\r\n\x1a\n")


def test_questions_are_answered_and_models_can_be_named(client):
    video = client.post(tracks())
    model = client.fit(video, preset="table")
    assert model.preset == "table" and math.isfinite(model.rmse)
    for mass in (o.mass for o in model.objects):
        assert mass.low95 <= mass.value <= mass.high95
        assert mass.high95 - mass.value == pytest.approx(1.96 * mass.sd)
    answer = client.ask(video, "What will happen next?", ["the red object and the blue object collide"], model=model.name)
    assert list(answer.choices.values())[0][0] and answer.text is None and answer.traces
    assert client.ask(video, "How many objects are there?").text == "2"


def test_questions_are_parsed_and_follow_each_other(client):
    video = client.post(tracks())
    read = client.parse("How many red objects are there?", video=video)
    assert read.program == ["objects", "red", "filter_color", "count"] and read.text
    assert client.ask(video, read.program).text == "1"
    first, words = "When does the red object hit the target?", {"target": "the blue object"}
    with pytest.raises(VrdpError, match="target"):
        client.parse(first, video=video)
    assert "blue" in client.parse(first, video=video, words=words).program
    assert "red" in client.parse("Is it moving?", video=video, previous=["How fast is the red object?"]).program
    listed = client.operations()
    assert any(o.name == "count" for o in listed.operations) and "root ::=" in listed.gbnf_grammar


def test_long_work_is_started_waited_for_and_cancelled(client):
    video = client.post(tracks())
    name = client.start("fit", video, preset="table", request_id=f"fit of {video}")
    seen = []
    model = client.wait(name, progress=lambda at: seen.append(at.fraction))
    assert model == client.fit(video, preset="table") and seen == sorted(seen)
    assert client.start("fit", video, preset="table", request_id=f"fit of {video}") == name
    with Client(os.environ["VRDP_SERVER"]) as other:
        assert other.wait(name) == model
        assert other.cancel(name).state == other.operation(name).state
    search = client.start("discover", [video], max_effects=1)
    if client.cancel(search).WhichOneof("result") == "error":
        with pytest.raises(VrdpError, match="CANCELLED"):
            client.wait(search)
    with pytest.raises(VrdpError, match="NOT_FOUND"):
        client.wait("operations/00")
    with pytest.raises(ValueError, match="cannot be started"):
        client.start(model)


def test_a_video_file_becomes_tracks(client):
    folder = Path(__file__).parents[3] / "tests" / "data" / "videos" / "scene_00011"
    seen = client.see(folder / "video.mp4", camera=json.loads((folder / "camera.json").read_text()))
    assert len(seen.video.objects) == 2 and seen.report.frames == 128
    with pytest.raises(VrdpError, match="known kind"):
        client.see(b"id,t,x,y")


def test_a_refusal_names_the_field(client):
    with pytest.raises(VrdpError, match="object") as refused:
        client.simulate(client.post(tracks()), remove=[7])
    assert refused.value.code is grpc.StatusCode.INVALID_ARGUMENT
    with Client("127.0.0.1:1") as nobody, pytest.raises(VrdpError, match="UNAVAILABLE"):
        nobody.post(tracks())
    with pytest.raises(ValueError, match="https"):
        Client("vrdp.example:50051", token="my-token")
    with pytest.raises(ValueError, match="cone"):
        client.post([{"id": 1, "frame": 0, "x": 0, "y": 0, "shape": "cone"}])
