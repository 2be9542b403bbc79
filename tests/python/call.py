"""Posts a scene to a running service over gRPC and asks for its future, with generated stubs and nothing of ours.

usage: call.py HOST:PORT OBSERVED.json   (with the generated modules on PYTHONPATH)
"""
import json
import sys

import grpc
from vrdp.v1 import reasoning_pb2 as reasoning, reasoning_pb2_grpc, videos_pb2 as videos, videos_pb2_grpc

server, scene = sys.argv[1], json.load(open(sys.argv[2]))
SHAPES = {"cylinder": {"disc": {"radius": 0.2}}, "sphere": {"ball": {"radius": 0.2}}, "cube": {"square": {"half_side": 0.2}}}
samples = {}
for row in scene["motion_trajectory"]:
    for o in row["objects"]:
        if o.get("inside_camera_view", True):
            x, y = o["location"][:2]
            samples.setdefault(o["object_id"], []).append({"frame": row["frame_id"], "position": {"x": x, "y": y}})
objects = [
    {"id": o["object_id"], "color": o["color"], "material": o["material"], "shape": SHAPES[o["shape"]], "samples": samples[o["object_id"]]}
    for o in scene["object_property"]
]
with grpc.insecure_channel(server) as channel:
    video = videos_pb2_grpc.VideosStub(channel).CreateVideo(videos.CreateVideoRequest(video={"objects": objects}))
    try:
        videos_pb2_grpc.VideosStub(channel).CreateVideo(videos.CreateVideoRequest(video={"objects": objects * 20}))
        raise AssertionError("taken though every id is there 20 times")
    except grpc.RpcError as refused:
        assert refused.code() is grpc.StatusCode.INVALID_ARGUMENT, refused
    future = reasoning_pb2_grpc.ReasoningStub(channel).Simulate(reasoning.SimulateRequest(video=video.name))
    assert len(future.frames) == future.observed_frames + 60
    for event in future.events:
        print(reasoning.EventKind.Name(event.kind), event.frame, list(event.object_ids), f"{event.probability:.2f}")
