"""The service is restarted by SIGTERM while 200 calls a second come with the published retry policy: no caller notices.

Usage: restarts.py VRDP SERVICE_CONFIG.json [RESTARTS]; the generated stubs are on PYTHONPATH.
"""

import asyncio
import collections
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time

import grpc
from vrdp.v1 import reasoning_pb2, reasoning_pb2_grpc, videos_pb2, videos_pb2_grpc

RATE = 200  # calls a second
PAUSE = 1.0  # seconds between restarts
LONGEST = 10.0  # seconds that an exit may take


def video():
    samples = [{"frame": f, "position": {"x": 0.02 * f, "y": 0.1}} for f in range(30)]
    return {"objects": [{"id": 1, "shape": {"disc": {"radius": 0.2}}, "samples": samples}]}


async def main():
    vrdp, config = sys.argv[1:3]
    restarts = int(sys.argv[3]) if len(sys.argv) > 3 else 3
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as data:
        command = [vrdp, "serve", "--listen", f"127.0.0.1:{port}", "--http", "", "--data-dir", data]

        def start():
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        service = start()
        options = [("grpc.service_config", pathlib.Path(config).read_text())]
        async with grpc.aio.insecure_channel(f"127.0.0.1:{port}", options=options) as channel:
            videos, reasoning = videos_pb2_grpc.VideosStub(channel), reasoning_pb2_grpc.ReasoningStub(channel)
            name = (await videos.CreateVideo(videos_pb2.CreateVideoRequest(video=video()))).name
            simulate = reasoning_pb2.SimulateRequest(video=name, rollouts=1)
            await reasoning.Simulate(simulate)
            outcomes, calls, slowest = collections.Counter(), set(), 0.0

            async def call(k):
                nonlocal slowest
                began = time.monotonic()
                try:
                    if k % 4 == 0:
                        await reasoning.Simulate(simulate, timeout=30)
                    else:
                        await videos.GetVideo(videos_pb2.GetVideoRequest(name=name), timeout=30)
                    outcomes["OK"] += 1
                except grpc.aio.AioRpcError as error:
                    outcomes[f"{error.code().name}: {error.details()}"] += 1
                slowest = max(slowest, time.monotonic() - began)

            async def load():
                began = time.monotonic()
                k = 0
                while True:
                    task = asyncio.create_task(call(k))
                    calls.add(task)
                    task.add_done_callback(calls.discard)
                    k += 1
                    await asyncio.sleep(max(0.0, began + k / RATE - time.monotonic()))

            loading = asyncio.create_task(load())
            exits = []
            for _ in range(restarts):
                await asyncio.sleep(PAUSE)
                began = time.monotonic()
                service.send_signal(signal.SIGTERM)
                code = await asyncio.to_thread(service.wait)
                exits.append(time.monotonic() - began)
                assert code == 0, f"exit status {code}"
                service = start()
            await asyncio.sleep(PAUSE)
            loading.cancel()
            await asyncio.gather(*calls)
        service.terminate()
        service.wait()
    print(f"{restarts} restarts, longest exit {max(exits):.2f} s, slowest call {slowest:.2f} s: {dict(outcomes)}")
    assert set(outcomes) == {"OK"} and max(exits) <= LONGEST


asyncio.run(main())
