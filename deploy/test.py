"""Posts a video and asks about it; `first` or `again`, when everything must be there still."""
import sys

from vrdp import Client

rows = [{"id": 1, "frame": f, "x": f / 25, "y": 0.0, "color": "red"} for f in range(30)]
rows += [{"id": 2, "frame": f, "x": 2.0, "y": 0.0, "color": "blue"} for f in range(30)]
with Client("127.0.0.1:50051", timeout=30) as client:
    if sys.argv[1] == "again":
        from vrdp.v1 import videos_pb2

        kept = client._one(client._videos.ListVideos, videos_pb2.ListVideosRequest()).videos
        assert [v.display_name for v in kept] == ["deployed"], kept
    video = client.post(rows, name="deployed")
    answer = client.ask(video, "Will the red object hit the blue object?")
    assert answer.text == "yes", answer
    print(sys.argv[1], answer.explanation)
