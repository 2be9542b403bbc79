//! What one tenant does is not felt by another. Fairness and cancellation under load are figures; these take minutes and are run
//! by hand, on a release build and a quiet machine:
//!
//! `cargo test --release --test service fairness -- --ignored --nocapture --test-threads 1`

use crate::harness::*;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use vrdp::api::v1;
use vrdp::engine::{
    AskedQuestion, Capacity, Engine, EngineError, MAX_REPLAYS, ModelSource, PublishedSimulation,
    ReplayOptions, SimulateOptions, StudyKind, Tenant,
};
use vrdp::fit::FitOptions;
use vrdp::reason::{AskOptions, Question};
use vrdp::scene::{CLEVRER_CAMERA, PointPair, Scene, calibrate, parse};

const WORKERS: usize = 2;

/// A number from the environment, or a usual one.
fn setting(name: &str, usual: usize) -> usize {
    std::env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(usual)
}

fn open(folder: &Path) -> Arc<Engine> {
    let capacity = Capacity { workers: WORKERS, queue: 256, job_timeout: Duration::from_secs(3600) };
    Arc::new(Engine::open(folder, capacity).unwrap())
}

fn scene(path: &str) -> Scene {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path).join("observed.json");
    parse(path, &std::fs::read_to_string(file).unwrap()).unwrap()
}

async fn post(engine: &Arc<Engine>, path: &str) -> String {
    let scene = scene(path);
    engine.create_video(|_| Ok((scene, vec![]))).await.unwrap().0
}

/// A counterfactual that was not asked before, and how long it took (s).
async fn counterfactual(engine: &Arc<Engine>, video: &str, seed: u64) -> Result<f64, EngineError> {
    let choices = vec!["The brown sphere and the cyan cylinder collide".to_string()];
    let question = Question::English { question: "What will happen if the cube is removed?".into(), choices };
    let (source, options) = (ModelSource::default_of("model"), AskOptions { seed, ..Default::default() });
    let start = Instant::now();
    let asked = AskedQuestion { question, conversation: Default::default(), lexicon: None };
    engine.ask(video, &source, asked, options).await?;
    Ok(start.elapsed().as_secs_f64())
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = ((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1));
    values.get(at).copied().unwrap_or(f64::NAN)
}

async fn simulated(engine: &Arc<Engine>, video: &str) -> Arc<PublishedSimulation> {
    let (interventions, frames, rollouts) = (vec![], Some(30), 2);
    let options = SimulateOptions { interventions, frames, rollouts, seed: 0, stills: false };
    engine.simulate(video, &ModelSource::default_of("model"), options).await.unwrap()
}

/// A small scene of that name, stored.
async fn small(engine: &Arc<Engine>, name: &str) -> String {
    let scene = Scene { name: name.into(), ..scene("clevrer/scene_00000") };
    engine.create_video(|_| Ok((scene, vec![]))).await.unwrap().0
}

#[tokio::test(flavor = "multi_thread")]
async fn a_deletion_empties_no_memory_but_that_of_its_video() {
    let folder = tempfile::tempdir().unwrap();
    let engine = open(folder.path());
    let [a, b] = ["a", "b"].map(|name| engine.of(&Tenant::new(name).unwrap()));
    let (kept, deleted) = (small(&a, "kept").await, small(&a, "deleted").await);
    assert_eq!(small(&b, "kept").await, kept, "ids are digests of the content");
    let (first, gone, other) =
        (simulated(&a, &kept).await, simulated(&a, &deleted).await, simulated(&b, &kept).await);
    // Neither what does not exist, nor another video, nor another tenant's video of the same id.
    let missing = "0".repeat(64);
    assert!(matches!(a.delete_video(&missing).await, Err(EngineError::NotFound { .. })));
    assert!(matches!(b.delete_video(&deleted).await, Err(EngineError::NotFound { .. })));
    assert!(Arc::ptr_eq(&simulated(&a, &deleted).await, &gone));
    a.delete_video(&deleted).await.unwrap();
    b.delete_video(&kept).await.unwrap();
    assert!(Arc::ptr_eq(&simulated(&a, &kept).await, &first), "the result is still in memory");
    // What was deleted is not found, and is computed again when it is stored again.
    assert!(matches!(a.video(&deleted).await, Err(EngineError::NotFound { .. })));
    small(&b, "kept").await;
    let again = simulated(&b, &kept).await;
    assert!(!Arc::ptr_eq(&again, &other) && again.trace == other.trace);
}

#[tokio::test(flavor = "multi_thread")]
async fn replays_of_one_tenant_leave_some_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let engine = open(folder.path());
    let [a, b] = ["a", "b"].map(|name| engine.of(&Tenant::new(name).unwrap()));
    let mut replays = vec![];
    for tenant in [&a, &b] {
        let video = small(tenant, "played").await;
        let trace = simulated(tenant, &video).await.trace.clone();
        let refused = loop {
            match tenant.replay(&trace, ReplayOptions::default()).await {
                Ok(replay) => replays.push(replay),
                Err(error) => break error,
            }
        };
        assert!(matches!(refused, EngineError::ShareFull { capacity: MAX_REPLAYS, .. }), "{refused}");
    }
    assert!(replays.len() < MAX_REPLAYS && replays.len() > MAX_REPLAYS / 2);
}

/// Samples how many jobs run until it is dropped.
struct Sampler {
    ends: Arc<AtomicBool>,
    samples: Arc<AtomicUsize>,
    most: Arc<AtomicUsize>,
}

impl Sampler {
    fn start(engine: &Arc<Engine>) -> Sampler {
        let sampler = Sampler { ends: Arc::default(), samples: Arc::default(), most: Arc::default() };
        let (ends, samples, most) = (sampler.ends.clone(), sampler.samples.clone(), sampler.most.clone());
        let engine = engine.clone();
        std::thread::spawn(move || {
            while !ends.load(Ordering::Relaxed) {
                most.fetch_max(engine.load().running, Ordering::Relaxed);
                samples.fetch_add(1, Ordering::Relaxed);
                std::thread::sleep(Duration::from_micros(500));
            }
        });
        sampler
    }

    fn end(self) -> String {
        self.ends.store(true, Ordering::Relaxed);
        let (samples, most) = (self.samples.load(Ordering::Relaxed), self.most.load(Ordering::Relaxed));
        assert!(most <= WORKERS, "{most} jobs ran on {WORKERS} workers");
        format!("at most {most} of {WORKERS} running in {samples} samples")
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes"]
async fn forty_discoveries_do_not_delay_counterfactuals() {
    let folder = tempfile::tempdir().unwrap();
    let engine = open(folder.path());
    let [a, b] = ["a", "b"].map(|name| engine.of(&Tenant::new(name).unwrap()));
    let video = post(&a, "clevrer/scene_00000").await;
    counterfactual(&a, &video, 0).await.unwrap();
    let mut alone = vec![];
    for seed in 1..200 {
        alone.push(counterfactual(&a, &video, seed).await.unwrap());
    }
    let mut videos = vec![];
    for k in 0..4 {
        videos.push(post(&b, &format!("effects/bullet_coriolis_medium/scene_{k:02}")).await);
    }
    let mut discoveries = vec![];
    for k in 0..40 {
        let kind = StudyKind::Discover { max_effects: 2, frames: Some(100 + k) };
        discoveries.push(b.study(&videos, &ModelSource::default_of("study"), kind).await.unwrap());
    }
    while engine.load().waiting + engine.load().running < 40 {
        tokio::task::yield_now().await;
    }
    let (sampler, count) = (Sampler::start(&engine), setting("VRDP_CALLS", 1000));
    let mut beside = vec![];
    for seed in 0..count as u64 {
        beside.push(counterfactual(&a, &video, 10_000 + seed).await.unwrap());
    }
    let ended = discoveries.iter().filter(|d| d.outcome().is_some()).count();
    let goal = 2.0 * percentile(&mut alone, 0.99) + 0.05;
    println!(
        "counterfactuals alone: p50 {:.1} ms, p99 {:.1} ms; beside 40 discoveries ({ended} ended): {} done, p50 {:.1} ms, \
         p99 {:.1} ms, goal {:.1} ms; {}",
        1e3 * percentile(&mut alone, 0.5),
        1e3 * percentile(&mut alone, 0.99),
        beside.len(),
        1e3 * percentile(&mut beside, 0.5),
        1e3 * percentile(&mut beside, 0.99),
        1e3 * goal,
        sampler.end(),
    );
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes"]
async fn two_tenants_share_the_cpu_though_one_asks_ten_times_as_much() {
    let folder = tempfile::tempdir().unwrap();
    let engine = open(folder.path());
    let (sampler, end) = (Sampler::start(&engine), Duration::from_secs(setting("VRDP_SECONDS", 60) as u64));
    let mut calls = tokio::task::JoinSet::new();
    let mut ready = vec![];
    for (name, callers) in [("a", 8), ("b", 80)] {
        let engine = engine.of(&Tenant::new(name).unwrap());
        let video = post(&engine, "clevrer/scene_00000").await;
        counterfactual(&engine, &video, 0).await.unwrap();
        ready.push((engine, video, callers));
    }
    let start = Instant::now();
    for (tenant, (engine, video, callers)) in ready.into_iter().enumerate() {
        for caller in 0..callers {
            let (engine, video) = (engine.clone(), video.clone());
            calls.spawn(async move {
                let mut done = 0_u64;
                while start.elapsed() < end {
                    let seed = 1 + done + 1_000_000 * caller;
                    counterfactual(&engine, &video, seed).await.unwrap();
                    done += 1;
                }
                (tenant, done)
            });
        }
    }
    let mut done = [0; 2];
    while let Some(call) = calls.join_next().await {
        let (tenant, count) = call.unwrap();
        done[tenant] += count;
    }
    let share = done[0] as f64 / (done[0] + done[1]) as f64;
    println!("8 callers against 80: {done:?} answers, share {share:.3} (goal 0.4 to 0.6); {}", sampler.end());
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes a minute"]
async fn equals_end_in_the_order_in_which_they_came() {
    let folder = tempfile::tempdir().unwrap();
    let engine = open(folder.path());
    let (sampler, started) = (Sampler::start(&engine), Arc::new(AtomicUsize::new(0)));
    let (mut passed_over, mut worst, jobs) = (0, 0, setting("VRDP_CALLS", 20_000));
    for first in (0..jobs).step_by(200) {
        let (mut calls, mut orders) = (vec![], vec![]);
        for k in first..first + 200 {
            let started = started.clone();
            let work = move || {
                let order = started.fetch_add(1, Ordering::SeqCst);
                std::hint::black_box((0..20_000).fold(k as u64, |a, b| a.wrapping_mul(31) ^ b));
                Ok(order)
            };
            let mut call = Box::pin(async { engine.compute(work).await.unwrap() });
            // The first poll puts it into the queue; it may even end by then.
            let ended = match futures_util::poll!(&mut call) {
                std::task::Poll::Ready(order) => Some(order),
                std::task::Poll::Pending => None,
            };
            calls.push((k, call, ended));
        }
        for (k, call, ended) in calls {
            let order = match ended {
                Some(order) => order,
                None => call.await,
            };
            orders.push((order, k));
        }
        // Older jobs that a job passes over when it starts. One that a worker has taken may wait there for the system to run its
        // thread; so each of the other workers may hold one.
        orders.sort_unstable();
        let mut waiting: BTreeSet<usize> = (first..first + 200).collect();
        for (_, k) in orders {
            waiting.remove(&k);
            let older = waiting.range(..k).count();
            passed_over += usize::from(older > 0);
            worst = worst.max(older);
        }
    }
    assert!(worst < WORKERS, "a job passed over {worst} older ones");
    println!("{jobs} equal jobs: {passed_over} passed over older ones, {worst} at most; {}", sampler.end());
}

/// CPU time of all threads of this process.
fn cpu() -> Duration {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let of = |path: std::path::PathBuf| {
        let text = std::fs::read_to_string(path.join("schedstat")).ok()?;
        text.split(' ').next()?.parse().ok().map(Duration::from_nanos)
    };
    tasks.filter_map(|task| of(task.path())).sum()
}

/// Drops calls at random times, and prints the CPU time that was used after that.
async fn cancelled<F: Future>(engine: &Arc<Engine>, name: &str, lasts: Duration, call: impl Fn(u64) -> F) {
    let points = setting("VRDP_POINTS", 100);
    let (mut after, mut number, mut early) = (vec![], 1_u64, 0);
    for k in 0..points as u64 {
        number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let wait = lasts.mul_f64((number >> 11) as f64 / (1_u64 << 53) as f64);
        early += usize::from(tokio::time::timeout(wait, call(k)).await.is_ok());
        let before = cpu();
        while engine.load() != Default::default() {
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        // The threads' last figures are a tick late.
        tokio::time::sleep(Duration::from_millis(5)).await;
        after.push(cpu().saturating_sub(before).as_secs_f64());
    }
    println!(
        "{name}: {points} points in {lasts:?} ({early} ended before): CPU after it p50 {:.1} ms, p99 {:.1} ms, most {:.1} ms",
        1e3 * percentile(&mut after, 0.5),
        1e3 * percentile(&mut after, 0.99),
        1e3 * percentile(&mut after, 1.0),
    );
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes"]
async fn cancelled_work_ends_soon() {
    let folder = tempfile::tempdir().unwrap();
    let engine = &open(folder.path());
    let only = std::env::var("VRDP_METHOD").unwrap_or_default();
    let wanted = |name: &str| only.is_empty() || name.starts_with(&only);
    let default = ModelSource::default_of("model");
    let mut crowd = vec![];
    for k in ["00000", "00006", "00011", "00022"] {
        crowd.push(post(engine, &format!("clevrer/scene_{k}")).await);
    }
    counterfactual(engine, &crowd[0], 0).await.unwrap();
    let options = |k: u64| FitOptions { max_iterations: 500 + k as usize, ..FitOptions::default() };
    if wanted("fit") {
        let fit = async |k: u64| engine.fit(&crowd[3], &default, options(k)).await.unwrap().finish().await;
        cancelled(engine, "fit", Duration::from_secs(2), fit).await;
    }
    if wanted("joint") {
        let fit = async |k: u64| {
            let joint = engine.fit_joint(crowd.clone(), &default, options(k)).await;
            joint.unwrap().finish().await
        };
        cancelled(engine, "joint fit", Duration::from_secs(6), fit).await;
    }
    if wanted("ask") {
        let ask = async |k: u64| counterfactual(engine, &crowd[0], k + 1).await;
        cancelled(engine, "ask", Duration::from_millis(60), ask).await;
    }
    if wanted("simulate") {
        let simulate = async |seed: u64| {
            let interventions = vec![];
            let wanted = SimulateOptions { interventions, frames: None, rollouts: 1000, seed, stills: false };
            engine.simulate(&crowd[0], &default, wanted).await
        };
        cancelled(engine, "simulate", Duration::from_secs(1), simulate).await;
    }
    if wanted("calibrate") {
        let pair = |k: usize| {
            let [x, y] = [0.05 * (k % 100) as f64 - 2.5, 0.02 * (k / 100) as f64 - 2.0];
            let image = CLEVRER_CAMERA.project(vrdp::num::vec2(x, y), 0.0).unwrap();
            let noise = (k * 7919 % 101) as f64 * 0.02;
            PointPair { image: [image[0] + noise, image[1] - noise], world: [x, y, 0.0] }
        };
        let pairs: Vec<PointPair> = (0..20_000).map(pair).collect();
        let calibrate = async |_: u64| {
            let pairs = pairs.clone();
            let work = move |stop: vrdp::num::Stop| Ok(calibrate(&pairs, [480.0, 320.0], stop).is_ok());
            engine.compute_as(vrdp::engine::JobKind::Calibration, work).await
        };
        cancelled(engine, "calibrate", Duration::from_millis(500), calibrate).await;
    }
    if wanted("create") {
        let request = crowded_detections(1600);
        let create = async |_: u64| {
            let request = request.clone();
            let work = move |stop: vrdp::num::Stop| Ok(vrdp::api::new_video(request, stop).is_ok());
            engine.compute_as(vrdp::engine::JobKind::Conversion, work).await
        };
        cancelled(engine, "create", Duration::from_secs(6), create).await;
    }
    if wanted("upload") {
        let request = rough_upload();
        let upload = async |_: u64| {
            let request = request.clone();
            let work = move |stop: vrdp::num::Stop| Ok(vrdp::api::new_video(request, stop).is_ok());
            engine.compute_as(vrdp::engine::JobKind::Conversion, work).await
        };
        cancelled(engine, "upload", Duration::from_secs(2), upload).await;
    }
    if wanted("discover") {
        let mut videos = vec![];
        for k in 0..4 {
            videos.push(post(engine, &format!("effects/bullet_coriolis_medium/scene_{k:02}")).await);
        }
        let discover = async |k: u64| {
            let kind = StudyKind::Discover { max_effects: 2, frames: Some(100 + k as usize) };
            engine.study(&videos, &ModelSource::default_of("study"), kind).await.unwrap().finish().await
        };
        let lasts = Duration::from_secs(setting("VRDP_DISCOVERY_SECONDS", 20) as u64);
        cancelled(engine, "discover", lasts, discover).await;
    }
}

/// A large video of tracks with noise.
fn rough_upload() -> v1::CreateVideoRequest {
    let rough = |s: v1::Sample| {
        let noise = 0.0005 * f64::from((s.frame * 7919) % 101);
        let Some(v1::sample::Place::Position(v1::Vector { x, y })) = s.place else { return s };
        let place = Some(v1::sample::Place::Position(v1::Vector { x: x + noise, y: y - noise }));
        v1::Sample { place, ..s }
    };
    let mut posted = crate::data::large_video();
    for object in &mut posted.objects {
        object.samples = std::mem::take(&mut object.samples).into_iter().map(rough).collect();
    }
    v1::CreateVideoRequest { video: Some(posted), ..Default::default() }
}

/// A video of 125 bodies that stand still.
fn crowded_detections(frames: u32) -> v1::CreateVideoRequest {
    let of_frame = |frame: u32| {
        (0..125).map(move |k| {
            let [left, top] = [20.0 + 17.0 * f64::from(k % 25), 150.0 + 30.0 * f64::from(k / 25)];
            let region = v1::detection::Region::Box(v1::Box { left, top, width: 12.0, height: 12.0 });
            v1::Detection { frame, region: Some(region), ..Default::default() }
        })
    };
    let camera = v1::Camera {
        matrix: CLEVRER_CAMERA.matrix.concat(),
        image_width: 480.0,
        image_height: 320.0,
        ..Default::default()
    };
    v1::CreateVideoRequest {
        video: Some(v1::Video { display_name: "crowd".into(), camera: Some(camera), ..video("", 1) })
            .map(|given| v1::Video { objects: vec![], ..given }),
        detections: (0..frames).flat_map(of_frame).collect(),
        ..Default::default()
    }
}
