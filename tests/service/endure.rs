//! Robustness under kills, load, panics and arbitrary input. With VRDP_LONG_TESTS=1 each test is as long as its goal asks.

use crate::harness::*;
use proptest::prelude::*;
use proptest::test_runner::{Config, TestCaseError, TestRunner};
use prost::Message;
use std::cell::Cell;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tonic::transport::Channel;
use vrdp::api::{self, v1};
use vrdp::engine::{Capacity, EngineError};

pub fn is_long() -> bool {
    std::env::var("VRDP_LONG_TESTS").is_ok_and(|v| v == "1")
}

/// The count that a goal asks for, or one that fits into every run.
pub fn count(long: usize, short: usize) -> usize {
    if is_long() { long } else { short }
}

/// Holds a test to inputs of a kind, and prints how long the slowest took and the most memory that all of them needed.
fn every<S: Strategy>(
    inputs: &S,
    [long, short]: [usize; 2],
    test: impl Fn(S::Value) -> Result<(), TestCaseError>,
) {
    let cases = count(long, short) as u32;
    let mut runner = TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
    let slowest = Cell::new(Duration::ZERO);
    let timed = |input| {
        let start = Instant::now();
        let passed = test(input);
        slowest.set(slowest.get().max(start.elapsed()));
        passed
    };
    runner.run(inputs, timed).unwrap();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let most = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("unknown").trim();
    println!("{cases} inputs, the slowest {:.3?}; memory at most {most}", slowest.get());
}

/// Resident memory of a process (MiB).
fn resident(process: &str) -> f64 {
    let statm = std::fs::read_to_string(format!("/proc/{process}/statm")).unwrap_or_default();
    let pages: f64 = statm.split(' ').nth(1).and_then(|v| v.parse().ok()).unwrap_or(0.0);
    pages * 4096.0 / (1 << 20) as f64
}

/// The program itself; it is killed where it is dropped.
pub struct Program {
    child: Child,
    url: String,
    ready_after: Duration,
}

impl Program {
    pub fn start(data: &Path) -> Program {
        Program::start_with(data, &[])
    }

    /// With settings in its environment.
    pub fn start_with(data: &Path, settings: &[(&str, &str)]) -> Program {
        let mut command = Command::new(env!("CARGO_BIN_EXE_vrdp"));
        command.envs(settings.iter().copied());
        Program::run(command, data).unwrap()
    }

    /// With files of at most so many blocks of 512 bytes, as on a disk that is full; `None` if it ends at once.
    pub fn start_cramped(data: &Path, blocks: u64) -> Option<Program> {
        let mut command = Command::new("sh");
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
        command.args(["-c", &script, env!("CARGO_BIN_EXE_vrdp")]);
        Program::run(command, data)
    }

    fn run(mut command: Command, data: &Path) -> Option<Program> {
        let start = Instant::now();
        let mut child = command
            .args(["serve", "--listen", "127.0.0.1:0", "--http", "", "--data-dir"])
            .arg(data)
            .env("VRDP_LOG", "off")
            .env_remove("VRDP_LONG_TESTS")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let url = format!("http://{}", line.trim().rsplit(' ').next().unwrap());
        let program = Program { url, child, ready_after: start.elapsed() };
        (!line.is_empty()).then_some(program)
    }

    pub fn address(&self) -> &str {
        &self.url["http://".len()..]
    }

    /// Its resident memory (MiB).
    pub fn resident(&self) -> f64 {
        resident(&self.child.id().to_string())
    }

    pub async fn channel(&self) -> Channel {
        Channel::from_shared(self.url.clone()).unwrap().connect().await.unwrap()
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        // SIGKILL.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Names that a client has received.
#[derive(Default)]
pub struct Acknowledged {
    pub videos: BTreeSet<String>,
    pub models: BTreeSet<String>,
    pub traces: BTreeSet<String>,
}

impl Acknowledged {
    fn extend(&mut self, more: Acknowledged) {
        self.videos.extend(more.videos);
        self.models.extend(more.models);
        self.traces.extend(more.traces);
    }
}

/// Posts videos and simulates them until the service is gone.
async fn load(channel: Channel, round: usize, client: usize, acknowledged: Arc<Mutex<Acknowledged>>) {
    for k in 0.. {
        let mut posted = video(&format!("{round} {client} {k}"), 12);
        posted.display_name = String::new();
        posted.fps = 20.0 + (round * 1000 + client * 100 + k) as f64 * 1e-3;
        let request = v1::CreateVideoRequest { video: Some(posted), ..Default::default() };
        let Ok(reply) = VideosClient::new(channel.clone()).create_video(request).await else { return };
        let name = reply.into_inner().name;
        acknowledged.lock().unwrap().videos.insert(name.clone());
        let request = v1::SimulateRequest { video: name, rollouts: Some(1), ..Default::default() };
        let Ok(reply) = ReasoningClient::new(channel.clone()).simulate(request).await else { return };
        let reply = reply.into_inner();
        let mut acknowledged = acknowledged.lock().unwrap();
        acknowledged.models.insert(reply.model);
        acknowledged.traces.insert(reply.trace);
    }
}

/// Everything that was acknowledged exists, nothing is doubled, and every file is whole.
pub async fn whole(channel: &Channel, acknowledged: &Acknowledged) {
    let traces = listed(channel, acknowledged).await;
    readable(channel, &traces).await;
}

/// All traces, after checks that everything acknowledged exists and nothing is doubled.
async fn listed(channel: &Channel, acknowledged: &Acknowledged) -> BTreeSet<String> {
    let mut videos = vec![];
    let mut request = v1::ListVideosRequest { page_size: 1000, ..Default::default() };
    loop {
        let page =
            VideosClient::new(channel.clone()).list_videos(request.clone()).await.unwrap().into_inner();
        videos.extend(page.videos.into_iter().map(|v| v.name));
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    let unique: BTreeSet<String> = videos.iter().cloned().collect();
    assert_eq!(unique.len(), videos.len());
    assert!(acknowledged.videos.is_subset(&unique), "missing: {:?}", acknowledged.videos.difference(&unique));
    for name in &acknowledged.models {
        let request = v1::GetModelRequest { name: name.clone(), ..Default::default() };
        ModelsClient::new(channel.clone()).get_model(request).await.unwrap();
    }
    let mut traces = BTreeSet::new();
    let mut request = v1::ListTracesRequest { page_size: 1000, ..Default::default() };
    loop {
        let page =
            TracesClient::new(channel.clone()).list_traces(request.clone()).await.unwrap().into_inner();
        traces.extend(page.traces.into_iter().map(|t| t.name));
        request.page_token = page.next_page_token;
        if request.page_token.is_empty() {
            break;
        }
    }
    assert!(acknowledged.traces.is_subset(&traces), "missing: {:?}", acknowledged.traces.difference(&traces));
    traces
}

async fn readable(channel: &Channel, traces: &BTreeSet<String>) {
    for name in traces {
        let request = v1::DownloadTraceRequest { name: name.clone() };
        let mut stream =
            TracesClient::new(channel.clone()).download_trace(request).await.unwrap().into_inner();
        let mut bytes = vec![];
        while let Some(chunk) = stream.message().await.unwrap() {
            bytes.extend(chunk.data);
        }
        let report = vrdp::recording::scan(std::io::Cursor::new(bytes), &mut |_| {}).unwrap();
        assert!(report.is_whole(), "{report:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_acknowledged_survives_kill_9() {
    // Hundreds would make `cargo test` slow for those who wait for it.
    let rounds = count(1000, if std::env::var_os("CI").is_some() { 200 } else { 20 });
    let folder = tempfile::tempdir().unwrap();
    // Names acknowledged since the last check, and before it.
    let (acknowledged, mut before) = (Arc::new(Mutex::new(Acknowledged::default())), Acknowledged::default());
    let mut slowest = Duration::ZERO;
    for round in 0..rounds {
        let program = Program::start(folder.path());
        slowest = slowest.max(program.ready_after);
        let channel = program.channel().await;
        if round % 20 == 1 {
            let fresh = std::mem::take(&mut *acknowledged.lock().unwrap());
            listed(&channel, &fresh).await;
            readable(&channel, &fresh.traces).await;
            before.extend(fresh);
        }
        let clients: Vec<_> =
            (0..4).map(|k| tokio::spawn(load(channel.clone(), round, k, acknowledged.clone()))).collect();
        // Any moment: the steps of a golden ratio fall everywhere.
        let moment = 0.05 + 0.6 * ((round as f64 + 1.0) * 0.618_033_988_75).fract();
        let traces = || acknowledged.lock().unwrap().traces.len();
        let at_start = traces();
        // However slow the machine is, some traces are acknowledged.
        while round % 3 == 0 && traces() == at_start {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        tokio::time::sleep(Duration::from_secs_f64(moment)).await;
        drop(program);
        for client in clients {
            client.await.unwrap();
        }
    }
    let program = Program::start(folder.path());
    before.extend(std::mem::take(&mut *acknowledged.lock().unwrap()));
    let channel = program.channel().await;
    whole(&channel, &before).await;
    // Files that a kill left without a record are removed at the start, in the background.
    let listed = listed(&channel, &before).await.len();
    let files = || std::fs::read_dir(folder.path().join("traces")).unwrap().count();
    let deadline = Instant::now() + Duration::from_secs(60);
    while files() > listed && Instant::now() < deadline {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert_eq!(files(), listed, "files without records");
    let (videos, traces) = (before.videos.len(), before.traces.len());
    assert!(videos >= rounds && traces > 0, "{videos} videos, {traces} traces");
    println!(
        "{rounds} kills: {videos} videos and {traces} traces acknowledged, none missing; ready after {slowest:?} at most"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_thousand_equal_requests_are_one_fit() {
    let callers = count(1000, 100);
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), CAPACITY).await;
    let video = service.create(video("many", 20)).await.unwrap();
    let worker = service.occupy().await;
    let mut streams = vec![];
    for _ in 0..callers {
        let engine = service.engine.clone();
        let id = video["videos/".len()..].to_string();
        streams.push(tokio::spawn(async move {
            let source =
                vrdp::engine::ModelSource { path: "start", kind: vrdp::engine::ModelSourceKind::Default };
            engine.fit(&id, &source, Default::default()).await.unwrap()
        }));
    }
    let mut waiting = vec![];
    for stream in streams {
        waiting.push(stream.await.unwrap());
    }
    drop((waiting.remove(0), worker));
    let mut fits = vec![];
    for caller in waiting {
        fits.push(caller.finish().await.unwrap());
    }
    assert!(fits.len() == callers - 1 && fits.iter().all(|fit| *fit == fits[0]));
    assert_eq!(service.engine.fits_run(), 1);
    drop(fits);
    service.stop().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn panics_in_one_job_of_a_hundred_are_nobody_elses() {
    let jobs = count(10_000, 1_000);
    let folder = tempfile::tempdir().unwrap();
    let service = start(folder.path(), Capacity { queue: 256, ..CAPACITY }).await;
    let before = resident("self");
    let mut ids = BTreeSet::new();
    for batch in 0..jobs / 100 {
        let one = |k: usize| {
            let engine = service.engine.clone();
            async move { engine.compute(move || if k == 37 { panic!("injected") } else { Ok(k) }).await }
        };
        for (k, done) in futures_util::future::join_all((0..100).map(one)).await.into_iter().enumerate() {
            match done {
                Ok(value) => assert!(value == k && k != 37),
                Err(EngineError::Internal { id, .. }) => assert!(k == 37 && ids.insert(id), "batch {batch}"),
                Err(other) => panic!("job {k}: {other}"),
            }
        }
    }
    assert_eq!(ids.len(), jobs / 100);
    let grown = resident("self") - before;
    // Other tests of this process use memory too, unless this one runs by itself.
    assert!(!is_long() || grown < 50.0, "{grown} MiB more");
    println!("{jobs} jobs, {} panics: {grown:.1} MiB more", ids.len());
    service.create(video("after", 20)).await.unwrap();
    service.stop().await;
}

#[test]
fn k_broken_fields_are_k_violations() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let service = runtime.block_on(start(folder.path(), CAPACITY));
    let places = proptest::collection::btree_set((0..3usize, 0..20usize, any::<bool>()), 1..20);
    every(&places, [1000, 40], |places| {
        let mut broken = video("broken", 20);
        let mut expected = vec![];
        for (object, sample, in_x) in places {
            let place = &mut broken.objects[object].samples[sample].place;
            let Some(v1::sample::Place::Position(position)) = place else { unreachable!() };
            *(if in_x { &mut position.x } else { &mut position.y }) = f64::NAN;
            let axis = if in_x { "x" } else { "y" };
            expected.push(format!("video.objects[{object}].samples[{sample}].position.{axis}"));
        }
        let status = runtime.block_on(service.create(broken)).unwrap_err();
        let mut named = fields(&status);
        named.sort();
        expected.sort();
        prop_assert_eq!(named, expected);
        Ok(())
    });
    runtime.block_on(service.stop());
}

#[test]
fn bytes_of_any_kind_are_a_scene_or_violations() {
    let good = v1::CreateVideoRequest { video: Some(fixture("scene_00000")), ..Default::default() };
    let good = good.encode_to_vec();
    let changes = proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12);
    let cut = proptest::option::of(any::<prop::sample::Index>());
    every(&(changes, cut), [100_000, 500], |(changes, cut)| {
        let mut bytes = good.clone();
        for (index, byte) in changes {
            let at = index.index(bytes.len());
            bytes[at] = byte;
        }
        bytes.truncate(cut.map_or(bytes.len(), |cut| cut.index(bytes.len())));
        if let Ok(request) = v1::CreateVideoRequest::decode(bytes.as_slice()) {
            match api::new_video(request, &vrdp::num::never) {
                Ok(made) => prop_assert!(made.scene.tracks.iter().all(|t| !t.samples.is_empty())),
                Err(EngineError::Invalid(violations)) => prop_assert!(!violations.is_empty()),
                Err(other) => prop_assert!(false, "{other}"),
            }
        }
        Ok(())
    });
}

#[test]
fn motions_of_any_kind_are_simulated_or_refused() {
    let number = || prop_oneof![6 => -3.0..3.0f64, 2 => Just(0.0), 1 => -1e4..1e4f64, 1 => prop::sample::select(vec![1e-300, 1e6, -1e6])];
    let shape = prop_oneof![
        (1e-3..2.0f64).prop_map(|radius| v1::shape::Kind::Disc(v1::shape::Disc { radius })),
        (1e-3..2.0f64).prop_map(|radius| v1::shape::Kind::Ball(v1::shape::Ball { radius })),
        (1e-3..2.0f64).prop_map(|half_side| v1::shape::Kind::Square(v1::shape::Square { half_side })),
    ];
    // Straight motion, and jumps of the tracker.
    type Motion = ([f64; 4], Vec<(f64, f64)>, u32, u32);
    let track = (
        prop::array::uniform4(number()),
        prop::collection::vec((number(), number()), 0..4),
        0..3u32,
        1..25u32,
    );
    let objects = prop::collection::vec((shape, track), 1..5);
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let service = runtime.block_on(start(folder.path(), CAPACITY));
    every(&objects, [2_000, 20], |objects| {
        let of = |(id, (shape, ([x, y, vx, vy], jumps, from, frames))): (usize, (_, Motion))| {
            let samples = (from..from + frames).map(|frame| {
                let t = f64::from(frame) / 25.0;
                let (jx, jy) = jumps.get(frame as usize / 7).copied().unwrap_or_default();
                let place =
                    v1::sample::Place::Position(v1::Vector { x: x + vx * t + jx, y: y + vy * t + jy });
                v1::Sample { frame, place: Some(place), ..Default::default() }
            });
            let shape = Some(v1::Shape { kind: Some(shape) });
            v1::Object { id: id as u32, shape, samples: samples.collect(), ..Default::default() }
        };
        let video =
            v1::Video { objects: objects.into_iter().enumerate().map(of).collect(), ..Default::default() };
        let done = runtime.block_on(async {
            let video = service.create(video).await?;
            let ask = v1::SimulateRequest { video, frames: 40, rollouts: Some(2), ..Default::default() };
            service.reasoning().simulate(ask).await
        });
        if let Err(status) = done {
            let known =
                [tonic::Code::InvalidArgument, tonic::Code::FailedPrecondition, tonic::Code::OutOfRange];
            prop_assert!(known.contains(&status.code()), "{:?}", status);
        }
        Ok(())
    });
    runtime.block_on(service.stop());
}

#[test]
fn questions_of_any_kind_are_answered_or_refused() {
    let words = "what will happen if the a red blue green rubber metal sphere cylinder cube object is removed \
        collide with which of following how many are there moving when video ends without enters exits scene \
        mass twice ? , 7 é";
    let tokens = "objects scene events filter_color filter_shape filter_collision red cube unique count exist \
        filter_moving filter_counterfact counterfactual_events get_counterfact remove union query_color not x";
    let list = |text: &'static str| prop::sample::select(text.split_whitespace().collect::<Vec<_>>());
    let sentence = prop::collection::vec(list(words), 0..14).prop_map(|words| words.join(" "));
    let program = prop::collection::vec(list(tokens), 0..8);
    let text = prop_oneof![sentence, ".{0,60}"].prop_map(v1::ask_request::Question::Text);
    let program = program.prop_map(|tokens| {
        let tokens = tokens.into_iter().map(String::from).collect();
        v1::ask_request::Question::Program(v1::Program { tokens })
    });
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let service = runtime.block_on(start(folder.path(), CAPACITY));
    let name = runtime.block_on(service.create(video("asked", 20))).unwrap();
    every(&prop_oneof![text, program], [20_000, 200], |question| {
        let request = v1::AskRequest {
            video: name.clone(),
            question: Some(question),
            rollouts: Some(1),
            ..Default::default()
        };
        if let Err(status) = runtime.block_on(service.reasoning().ask(request)) {
            prop_assert_eq!(status.code(), tonic::Code::InvalidArgument, "{:?}", status);
        }
        Ok(())
    });
    runtime.block_on(service.stop());
}
