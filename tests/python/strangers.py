"""Connections that say nothing fill both ports of a service with 1,024 files: new clients are served, and traces are written.

Usage: strangers.py VRDP [CONNECTIONS]; so many to each port. The generated stubs are on PYTHONPATH.
"""

import pathlib
import resource
import socket
import subprocess
import sys
import tempfile
import time

import grpc
from vrdp.v1 import reasoning_pb2, reasoning_pb2_grpc, videos_pb2, videos_pb2_grpc

CLIENTS = 20
FILES = 1024


def video():
    samples = [{"frame": f, "position": {"x": 0.02 * f, "y": 0.1}} for f in range(30)]
    return {"objects": [{"id": 1, "shape": {"disc": {"radius": 0.2}}, "samples": samples}]}


def silent(port, count):
    """Opens connections and waits for none of them."""
    opened = []
    for k in range(count):
        connection = socket.socket()
        connection.setblocking(False)
        # From five addresses, so that ports do not run out.
        connection.bind((f"127.0.0.{2 + k % 5}", 0))
        connection.connect_ex(("127.0.0.1", port))
        opened.append(connection)
        if k % 500 == 0:
            time.sleep(0.02)
    return opened


def simulate(port, seed, name=None):
    """A new client's fresh simulation, or a first one with its video; the video and the seconds."""
    start = time.monotonic()
    with grpc.insecure_channel(f"127.0.0.1:{port}", options=[("grpc.use_local_subchannel_pool", 1)]) as channel:
        if name is None:
            name = videos_pb2_grpc.VideosStub(channel).CreateVideo(videos_pb2.CreateVideoRequest(video=video())).name
        request = reasoning_pb2.SimulateRequest(video=name, rollouts=1, seed=seed)
        assert reasoning_pb2_grpc.ReasoningStub(channel).Simulate(request, timeout=30).trace
    return name, time.monotonic() - start


def stored(data):
    return len(list(pathlib.Path(data, "traces").iterdir()))


def main():
    vrdp, count = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    count = min(count, (most - 200) // 2)
    with tempfile.TemporaryDirectory() as data:
        limited = ["bash", "-c", f'ulimit -n {FILES}; exec "$0" "$@"', vrdp]
        command = [*limited, "serve", "--listen", "127.0.0.1:0", "--http", "127.0.0.1:0", "--data-dir", data]
        service = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        try:
            grpc_port, http_port = (int(service.stdout.readline().strip(" /\n").rsplit(":", 1)[1]) for _ in range(2))
            name, _ = simulate(grpc_port, 1)
            before = stored(data)
            held = silent(grpc_port, count) + silent(http_port, count)
            time.sleep(1)
            seconds = sorted(simulate(grpc_port, 100 + k, name)[1] for k in range(CLIENTS))
            assert stored(data) == before + CLIENTS, "a trace is missing"
            start = time.monotonic()
            with socket.create_connection(("127.0.0.1", http_port), timeout=10) as page:
                page.sendall(f"GET /livez HTTP/1.1\r\nHost: 127.0.0.1:{http_port}\r\n\r\n".encode())
                assert page.recv(100).startswith(b"HTTP/1.1 200"), "the HTTP port does not answer"
            live = time.monotonic() - start
            files = len(list(pathlib.Path(f"/proc/{service.pid}/fd").iterdir()))
            print(
                f"{len(held)} silent connections, {FILES} files ({files} open): a new client's fresh simulation takes "
                f"{1e3 * seconds[len(seconds) // 2]:.0f} ms (median; {1e3 * seconds[-1]:.0f} at most), /livez {1e3 * live:.0f} ms"
            )
        finally:
            service.kill()
            service.wait()


main()
