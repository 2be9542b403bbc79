"""Reads a trace with Foxglove's own library and checks that every frame and event is in it.

usage: read_trace.py FILE.mcap RESULT.json   (what `vrdp simulate --trace FILE.mcap --json RESULT.json` wrote)
"""
import json
import sys
from collections import Counter

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

ENSEMBLE = ["/ensemble/mean", "/ensemble/mean/poses", "/ensemble/rollouts"]
FRAMES = ENSEMBLE + ["/simulated/states", "/simulated/poses", "/simulated/transforms"]

path, result = sys.argv[1], json.load(open(sys.argv[2]))
counts, states, rollouts, shown, placed = Counter(), [], [], set(), set()
with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        assert decoded.DESCRIPTOR.full_name == schema.name, (decoded.DESCRIPTOR.full_name, schema.name)
        counts[channel.topic] += 1
        if channel.topic == "/simulated/states":
            states.append(decoded)
        if channel.topic == "/ensemble/rollouts":
            rollouts.append(decoded)
        if channel.topic == "/simulated/scene":
            assert all(e.frame_locked and e.frame_id == e.id for e in decoded.entities)
            shown |= {e.frame_id for e in decoded.entities}
        if channel.topic == "/simulated/transforms":
            placed |= {t.child_frame_id for t in decoded.transforms}
            assert placed <= shown, (placed, shown)
    attachments = {a.name: a.data if a.name.endswith(".cbor") else json.loads(a.data) for a in reader.iter_attachments()}
    metadata = {m.name: m.metadata for m in reader.iter_metadata()}["vrdp"]

for topic in FRAMES:
    assert counts[topic] == len(result["frames"]), (topic, counts[topic], len(result["frames"]))
for topic in ["/events", "/log"]:
    assert counts[topic] == len(result["events"]), (topic, counts[topic], len(result["events"]))
for frame, state in zip(result["frames"], states):
    want = [(o["object_id"], o["x"], o["y"], o["vx"], o["vy"]) for o in frame["objects"]]
    assert want == [(s.object_id, s.x, s.y, s.vx, s.vy) for s in state.states], frame["frame"]
assert placed and placed == shown, (placed, shown)
drawn = int(metadata["rollouts_kept"])
for row in rollouts:
    assert drawn > 1 and len(row.x) == len(row.y) == len(row.yaw) == drawn * len(row.object_ids), row.frame
assert attachments.keys() == {"request.json", "model.json", "scene.json", "fit.cbor"}, attachments.keys()
assert metadata["build"] and metadata["model"], metadata
print(f"{path}: {len(states)} frames, {counts['/events']} events, {len(counts)} topics: whole")
