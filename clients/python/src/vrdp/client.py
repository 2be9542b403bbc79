"""Posts tracks, fits, simulates, asks and discovers; tables are pandas frames if pandas is installed."""
from __future__ import annotations

import csv
import io
import ipaddress
import json
import os
import time
import uuid
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import grpc

from .v1 import common_pb2, concepts_pb2, concepts_pb2_grpc, discovery_pb2, models_pb2, models_pb2_grpc, operations_pb2, operations_pb2_grpc
from .v1 import reasoning_pb2, reasoning_pb2_grpc, traces_pb2, traces_pb2_grpc, videos_pb2, videos_pb2_grpc

if TYPE_CHECKING:
    import pandas

    Tracks = Union[str, os.PathLike[str], bytes, pandas.DataFrame, Iterable[Mapping[str, Any]]]

#: Largest accepted message (bytes): a whole long simulation.
MAX_MESSAGE = 64 << 20
#: Codes of a connection or a wait that was cut short; the operation goes on.
_CUT = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED)
#: Broken connections in a row, a second apart, after which a wait gives up.
MAX_FAILURES = 60
_SHAPES = ("ball", "cube", "cylinder", "disc", "sphere", "square")
#: How files begin in front of which no line can be put: UTF-16, archives, XML and JSON.
_CLOSED = (b"\xff\xfe", b"\xfe\xff", b"PK", b"<", b"{")


class VrdpError(Exception):
    """A refused call: its status, the wrong field and the reason."""

    def __init__(self, code: grpc.StatusCode, message: str):
        self.code = code
        super().__init__(f"{code.name}: {message}")

    @classmethod
    def of(cls, error: grpc.RpcError) -> VrdpError:
        return cls(error.code(), error.details())


@dataclass(frozen=True)
class Answer:
    #: The open answer; None if choices were judged.
    text: str | None
    #: Whether each choice is correct, and with which probability.
    choices: dict[str, tuple[bool, float]]
    probability: float
    explanation: str
    traces: list[str]


@dataclass(frozen=True)
class Reading:
    #: The tokens, in postfix order.
    program: list[str]
    choices: list[list[str]]
    #: The program in English.
    text: str


@dataclass(frozen=True)
class Simulation:
    #: The whole reply of the service.
    reply: reasoning_pb2.SimulateResponse

    @property
    def trace(self) -> str:
        return self.reply.trace

    @property
    def events(self) -> list[dict[str, Any]]:
        name = reasoning_pb2.EventKind.Name
        return [
            {
                "kind": name(e.kind).removeprefix("EVENT_KIND_").lower(),
                "frame": e.frame,
                "time": e.time,
                "object_ids": list(e.object_ids),
                "probability": e.probability,
            }
            for e in self.reply.events
        ]

    def rows(self) -> list[dict[str, Any]]:
        """One row an object and frame: frame, time, id, x, y, yaw, vx, vy, spin, sd, observed (within the video)."""
        keys = ("x", "y", "yaw", "vx", "vy", "spin", "sd")
        return [
            {"frame": f.frame, "time": f.time, "id": o.object_id}
            | {k: getattr(o, k) for k in keys}
            | {"observed": f.frame < self.reply.observed_frames}
            for f in self.reply.frames
            for o in f.objects
        ]

    def frame(self) -> pandas.DataFrame:
        """:meth:`rows` as a pandas frame."""
        import pandas

        return pandas.DataFrame(self.rows())


class Client:
    """A connection to a service, such as ``Client("127.0.0.1:50051")``; close it, or use ``with``.

    ``https://HOST:PORT`` or a ``ca`` switches TLS on (``ca``: PEM bytes of the certificate authority; default: gRPC's own
    authorities). ``token`` is sent as a bearer token. Failed calls are retried by the retry policy of the service, and end
    after ``timeout`` seconds.
    """

    def __init__(self, server: str, *, ca: bytes | None = None, token: str | None = None, timeout: float = 300.0):
        options = [
            ("grpc.max_receive_message_length", MAX_MESSAGE),
            ("grpc.max_send_message_length", MAX_MESSAGE),
            ("grpc.service_config", _retries()),
        ]
        secure = ca is not None or server.startswith("https://")
        address = server.removeprefix("https://").removeprefix("http://")
        if _is_here(address):
            # No proxy reaches this machine.
            options.append(("grpc.enable_http_proxy", 0))
        if token and not secure and not _is_here(address):
            raise ValueError(f"the token would be sent to {address} without encryption; use https://")
        if secure:
            self._channel = grpc.secure_channel(address, grpc.ssl_channel_credentials(ca), options)
        else:
            self._channel = grpc.insecure_channel(address, options)
        self._call = {"timeout": timeout, "metadata": [("authorization", f"Bearer {token}")] if token else None}
        self._videos = videos_pb2_grpc.VideosStub(self._channel)
        self._models = models_pb2_grpc.ModelsStub(self._channel)
        self._reasoning = reasoning_pb2_grpc.ReasoningStub(self._channel)
        self._concepts = concepts_pb2_grpc.ConceptsStub(self._channel)
        self._traces = traces_pb2_grpc.TracesStub(self._channel)
        self._operations = operations_pb2_grpc.OperationsStub(self._channel)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._channel.close()

    def _one(self, method: Any, request: Any) -> Any:
        try:
            return method(request, **self._call)
        except grpc.RpcError as error:
            raise VrdpError.of(error) from None

    def _last(self, method: Any, request: Any) -> Any:
        """The last message of a stream of progress."""
        last = None
        try:
            for last in method(request, **self._call):
                pass
        except grpc.RpcError as error:
            raise VrdpError.of(error) from None
        return last

    def post(
        self,
        tracks: Tracks,
        *,
        fps: float | None = None,
        unit: str | None = None,
        scale: float | None = None,
        world: str | None = None,
        shape: str | None = None,
        size: float | None = None,
        name: str = "",
        setup: str = "",
    ) -> str:
        """Stores a video and returns its name; equal tracks give the same name.

        ``tracks`` is a file (its path, or its bytes) in any format that ``vrdp import`` reads but detections, a pandas or
        polars frame, or rows as mappings: a row an object and frame, with ``id``, ``t`` (s) or ``frame``, ``x``, ``y`` (m),
        and optional ``yaw`` (rad), ``shape``, ``size`` (radius or half side, m), ``mass`` (kg), ``color``, ``material``. A
        unit stands behind a name, as in ``x [mm]``; absent values and NaN mean that the object was not seen.

        ``fps``, ``unit`` (of lengths), ``scale`` (m per pixel), ``shape`` and ``size`` (in ``unit``) hold for all rows. What
        neither states is assumed; a warning says so.
        """
        if shape is not None and shape not in _SHAPES:
            raise ValueError(f"shape is {shape!r}; it must be one of {', '.join(sorted(_SHAPES))}")
        notes = {"fps": fps, "unit": unit, "scale": scale, "world": world, "shape": shape, "size": size, "setup": setup or None}
        file = _file(tracks, {key: value for key, value in notes.items() if value is not None})
        request = videos_pb2.CreateVideoRequest(video=videos_pb2.Video(display_name=name), file=file)
        video = self._one(self._videos.CreateVideo, request)
        if video.assumptions:
            warnings.warn("assumed, as the tracks do not state it: " + "; ".join(video.assumptions), stacklevel=2)
        return video.name

    def see(
        self,
        file: str | os.PathLike[str] | bytes,
        *,
        camera: Mapping[str, Any] | None = None,
        metres_per_pixel: float = 0.0,
        ball_radius: float = 0.0,
        size: float = 0.0,
        name: str = "",
        setup: str = "",
    ) -> videos_pb2.ImportedVideo:
        """Finds the objects of a video file and stores their tracks; ``video.name`` of the result names them.

        ``camera`` is what ``vrdp calibrate --json`` writes (``camera_matrix``, ``image_size``); without it the camera stands
        straight above, and ``metres_per_pixel`` or ``ball_radius`` (m) gives the scale. ``report`` says how objects were seen.
        """
        options = videos_pb2.ImportVideoOptions(
            display_name=name, setup=setup, metres_per_pixel=metres_per_pixel, ball_radius=ball_radius, object_size=size
        )
        if camera is not None:
            width, height = camera["image_size"]
            matrix = [number for row in camera["camera_matrix"][:3] for number in row]
            options.camera.CopyFrom(videos_pb2.Camera(matrix=matrix, image_width=width, image_height=height))
        data = file if isinstance(file, bytes) else Path(file).read_bytes()

        def parts() -> Iterable[videos_pb2.ImportVideoRequest]:
            yield videos_pb2.ImportVideoRequest(options=options)
            for start in range(0, len(data), 1 << 20):
                yield videos_pb2.ImportVideoRequest(data=data[start : start + (1 << 20)])

        return self._last(self._videos.ImportVideo, parts()).imported

    def fit(self, video: str, *, preset: str | None = None) -> models_pb2.Model:
        """Fits a model to the video and stores it."""
        return self._last(self._models.FitModel, _fit(video, preset=preset)).model

    def simulate(
        self,
        video: str,
        *,
        model: str | None = None,
        remove: Sequence[int] = (),
        mass: Mapping[int, float] | None = None,
        velocity: Mapping[int, tuple[float, float]] | None = None,
        without: Sequence[str] = (),
        frames: int = 0,
        seed: int = 0,
    ) -> Simulation:
        """Predicts, or simulates a counterfactual: objects removed, masses multiplied, velocities set (m/s), effects off."""
        edits: list[dict[str, Any]] = [{"remove": {"object_id": i}} for i in remove]
        edits += [{"scale_mass": {"object_id": i, "factor": f}} for i, f in (mass or {}).items()]
        edits += [{"set_velocity": {"object_id": i, "velocity": {"x": x, "y": y}}} for i, (x, y) in (velocity or {}).items()]
        edits += [{"switch_effect": {"effect": e, "on": False}} for e in without]
        request = reasoning_pb2.SimulateRequest(
            video=video, model=_choice(model), interventions=edits, frames=frames, seed=seed
        )
        return Simulation(self._one(self._reasoning.Simulate, request))

    def ask(
        self,
        video: str,
        question: str | Sequence[str],
        choices: Sequence[str] = (),
        *,
        model: str | None = None,
        lexicon: str = "",
        previous: Sequence[str] = (),
        words: Mapping[str, str] | None = None,
    ) -> Answer:
        """Answers a question in English, or a program given as a list of tokens; with choices, judges each.

        With a lexicon (:meth:`learn_word`), its words describe the objects. ``previous`` are the questions before, so that "it" and
        "and when?" are understood; ``words`` are your own, such as ``{"cue ball": "white ball"}``.
        """
        asked = _asked(question, choices, previous, words)
        request = reasoning_pb2.AskRequest(video=video, model=_choice(model), lexicon=lexicon, **asked)
        reply = self._one(self._reasoning.Ask, request)
        return Answer(
            text=reply.answer if reply.HasField("answer") else None,
            choices={c.choice: (c.correct, c.probability) for c in reply.choices},
            probability=reply.probability,
            explanation=reply.explanation,
            traces=list(reply.traces),
        )

    def parse(
        self,
        question: str | Sequence[str],
        choices: Sequence[str] = (),
        *,
        video: str = "",
        previous: Sequence[str] = (),
        words: Mapping[str, str] | None = None,
    ) -> Reading:
        """How a question is understood, without a fit or a simulation; with a video its objects are resolved."""
        asked = _asked(question, choices, previous, words)
        reply = self._one(self._reasoning.ParseQuestion, reasoning_pb2.ParseQuestionRequest(video=video, **asked))
        return Reading(list(reply.program.tokens), [list(c.tokens) for c in reply.choices], reply.reading)

    def operations(self) -> reasoning_pb2.ReasoningListOperationsResponse:
        """The operations of programs, and a JSON schema and a GBNF grammar for a parser of your own."""
        return self._one(self._reasoning.ListOperations, reasoning_pb2.ReasoningListOperationsRequest())

    def learn_word(
        self,
        name: str,
        yes: Iterable[tuple[str, int] | tuple[str, int, int, int]],
        no: Iterable[tuple[str, int] | tuple[str, int, int, int]],
        *,
        kind: str = "static",
        base: str = "",
    ) -> concepts_pb2.Lexicon:
        """Learns a word from objects that it fits and objects that it does not, as pairs of video and object id.

        ``kind`` is ``"static"`` (looks), ``"dynamic"`` (motion) or ``"event"``; ``base`` names the lexicon that the word is added to.
        An example of an event is a video, two object ids and about the frame at which they meet or pass each other.
        """
        keys = ("video", "object_id", "other_id", "frame")
        of = lambda examples: [dict(zip(keys, example)) for example in examples]  # noqa: B905, E731
        word = {"name": name, "kind": f"CONCEPT_KIND_{kind.upper()}", "yes": of(yes), "no": of(no)}
        request = concepts_pb2.LearnConceptsRequest(base=base, examples=word)
        return self._last(self._concepts.LearnConcepts, request).lexicon

    def learn_change(
        self,
        name: str,
        quantity: str,
        yes: Iterable[tuple[str, int, str]],
        no: Iterable[tuple[str, int, str]] = (),
        *,
        base: str = "",
    ) -> concepts_pb2.Lexicon:
        """Learns a word for a change, such as "heavier", from videos in which an object is changed.

        ``quantity`` is ``"mass"``, ``"velocity"``, ``"restitution"`` or ``"friction"``. An example is a video, an object id, and a
        video with the same objects and ids in which that object is changed; those of ``no`` show no such change.
        """
        keys = ("video", "object_id", "changed_video")
        of = lambda examples: [dict(zip(keys, example)) for example in examples]  # noqa: B905, E731
        word = {"name": name, "kind": "CONCEPT_KIND_CHANGE", "quantity": f"CHANGED_QUANTITY_{quantity.upper()}"}
        request = concepts_pb2.LearnConceptsRequest(base=base, examples={**word, "yes": of(yes), "no": of(no)})
        return self._last(self._concepts.LearnConcepts, request).lexicon

    def discover(self, videos: Sequence[str], *, max_effects: int = 2) -> discovery_pb2.Discovery:
        """Finds the effects that the model of a set-up lacks, from its videos."""
        return self._last(self._models.DiscoverEffects, _discover(videos, max_effects=max_effects)).discovery

    def start(self, work: Any, *args: Any, request_id: str = "", **options: Any) -> str:
        """Starts long work that goes on if this program ends; returns its name, for :meth:`wait` and :meth:`cancel`.

        ``work`` is ``"fit"`` or ``"discover"``, with the arguments of that method, or a request of ``vrdp.v1``. Starting with
        the same ``request_id`` again returns the first operation.
        """
        request = _WORK[work](*args, **options) if isinstance(work, str) else work
        start = operations_pb2.StartOperationRequest(request_id=request_id or uuid.uuid4().hex)
        fields = {f.message_type.full_name: f.name for f in start.DESCRIPTOR.oneofs_by_name["work"].fields}
        if request.DESCRIPTOR.full_name not in fields:
            raise ValueError(f"{request.DESCRIPTOR.name} cannot be started; it must be one of {', '.join(fields)}")
        getattr(start, fields[request.DESCRIPTOR.full_name]).CopyFrom(request)
        return self._one(self._operations.StartOperation, start).name

    def operation(self, name: str) -> operations_pb2.Operation:
        """How an operation stands; with its result if it is done."""
        return self._one(self._operations.GetOperation, operations_pb2.GetOperationRequest(name=name))

    def wait(
        self,
        name: str,
        *,
        timeout: float | None = None,
        progress: Callable[[common_pb2.Progress], None] | None = None,
    ) -> Any:
        """Waits for an operation, across broken connections, and returns its result: a model, a discovery, ...

        Raises :class:`VrdpError` if it failed or was cancelled, and TimeoutError after ``timeout`` seconds; it then still runs.
        """
        request = operations_pb2.WaitOperationRequest(name=name)
        end = None if timeout is None else time.monotonic() + timeout
        failures = 0
        while True:
            try:
                for now in self._operations.WaitOperation(request, **self._call):
                    failures = 0
                    if now.done:
                        return _result(now)
                    if progress:
                        progress(now.progress)
                    if end is not None and time.monotonic() >= end:
                        raise TimeoutError(f"{name} still runs after {timeout} s")
            except grpc.RpcError as error:
                failures += error.code() is not grpc.StatusCode.DEADLINE_EXCEEDED
                if error.code() not in _CUT or failures > MAX_FAILURES:
                    raise VrdpError.of(error) from None
            if end is not None and time.monotonic() >= end:
                raise TimeoutError(f"{name} still runs after {timeout} s")
            time.sleep(1.0)

    def cancel(self, name: str) -> operations_pb2.Operation:
        """Stops an operation, unless it is done; returns how it stands."""
        return self._one(self._operations.CancelOperation, operations_pb2.CancelOperationRequest(name=name))

    def trace(self, name: str) -> bytes:
        """The MCAP file of a trace."""
        try:
            parts = self._traces.DownloadTrace(traces_pb2.DownloadTraceRequest(name=name), **self._call)
            return b"".join(part.data for part in parts)
        except grpc.RpcError as error:
            raise VrdpError.of(error) from None


def _file(tracks: Tracks, notes: Mapping[str, Any]) -> bytes:
    """The bytes of a file of tracks, with a line in front for each note."""
    if isinstance(tracks, (str, os.PathLike)):
        content = Path(tracks).read_bytes()
    elif isinstance(tracks, (bytes, bytearray)):
        content = bytes(tracks)
    elif hasattr(tracks, "to_csv"):
        # An index with a name, or below columns of several levels, holds frames or ids.
        indexed = getattr(tracks.columns, "nlevels", 1) > 1 or any(level is not None for level in tracks.index.names)
        content = tracks.to_csv(index=indexed).encode()
    elif hasattr(tracks, "write_csv"):
        content = tracks.write_csv().encode()
    else:
        rows = [dict(row) for row in tracks]
        for row in rows:
            if row.get("shape") and row["shape"] not in _SHAPES:
                raise ValueError(f"shape is {row['shape']!r}; it must be one of {', '.join(_SHAPES)}")
        text = io.StringIO()
        table = csv.DictWriter(text, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        content = text.getvalue().encode()
    if notes and content.startswith(_CLOSED):
        raise ValueError(f"{', '.join(notes)} cannot be given beside this kind of file; state it in the file, or give CSV")
    mark = b"\xef\xbb\xbf"
    return "".join(f"# {key}: {value}\n" for key, value in notes.items()).encode() + content.removeprefix(mark)


def _asked(
    question: str | Sequence[str],
    choices: Sequence[str] | Sequence[Sequence[str]],
    previous: Sequence[str],
    words: Mapping[str, str] | None,
) -> dict[str, Any]:
    """The fields of a question, in English or as a program."""
    if isinstance(question, str):
        asked: dict[str, Any] = {"text": question, "choices": [{"text": c} for c in choices]}
    else:
        asked = {"program": {"tokens": question}, "choices": [{"program": {"tokens": c}} for c in choices]}
    own = [{"word": word, "means": means} for word, means in (words or {}).items()]
    return asked | {"previous": list(previous), "words": own}


def _choice(model: str | None) -> common_pb2.ModelChoice | None:
    """A preset by its name, or a fitted model by its resource name."""
    if model is None:
        return None
    return common_pb2.ModelChoice(model=model) if model.startswith("videos/") else common_pb2.ModelChoice(preset=model)


def _fit(video: str, *, preset: str | None = None) -> models_pb2.FitModelRequest:
    return models_pb2.FitModelRequest(parent=video, start=_choice(preset))


def _discover(videos: Sequence[str], *, max_effects: int = 2) -> discovery_pb2.DiscoverEffectsRequest:
    return discovery_pb2.DiscoverEffectsRequest(study={"videos": videos}, max_effects=max_effects)


_WORK = {"fit": _fit, "discover": _discover}


def _result(done: operations_pb2.Operation) -> Any:
    """The result of an operation that is done; of a fit, the model."""
    kind = done.WhichOneof("result")
    if kind == "error":
        code = next(c for c in grpc.StatusCode if c.value[0] == done.error.code)
        raise VrdpError(code, done.error.message)
    return done.fitted.model if kind == "fitted" else getattr(done, kind)


def _retries() -> str:
    """The retry policy of the service, without waiting for a server that does not listen."""
    config = json.loads(files("vrdp.v1").joinpath("service_config.json").read_text())
    for method in config["methodConfig"]:
        method["waitForReady"] = False
    return json.dumps(config)


def _is_here(address: str) -> bool:
    host = address.rpartition(":")[0].strip("[]")
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
