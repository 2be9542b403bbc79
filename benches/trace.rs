//! Measures traces: encoding and storing one of 128 frames and 6 objects; playing and seeking in 1 GiB.

use criterion::{Criterion, criterion_group, criterion_main};
use std::fs::File;
use std::hint::black_box;
use std::io::BufWriter;
use std::time::Instant;
use vrdp::fit::{FitOptions, fit};
use vrdp::num::never;
use vrdp::reason::{PredictionRequest, predict};
use vrdp::recording::messages::{STATES, v1};
use vrdp::recording::{MAX_TIME, Recording, TraceReader, encode};
use vrdp::scene::{Scene, parse};
use vrdp::store::Store;
use vrdp::world::Preset;

const SCENE: &str = include_str!("../tests/data/clevrer/scene_00000/observed.json");
const FRAMES: usize = 128;
const OBJECTS: usize = 6;
const GIB: u64 = 1 << 30;

fn benches(criterion: &mut Criterion) {
    let scene = crowded(parse("scene", SCENE).expect("the committed scene is valid"));
    let start = Preset::for_world(scene.world).model(&scene);
    let fit = fit(std::slice::from_ref(&scene), &[start], &FitOptions::default(), &never)
        .expect("the committed scene can be fitted");
    for rollouts in [0, 32] {
        let request = PredictionRequest { interventions: vec![], frames: FRAMES, rollouts, seed: 0 };
        let prediction = predict(&scene, &fit, 0, &request, &never).expect("the fit can be simulated");
        let recording = Recording {
            scene: &scene,
            prediction: &prediction,
            fit: &fit,
            video: "v",
            model: "m",
            seed: 0,
            request_json: "{}",
            stills: &[],
        };
        let bytes = encode(&recording).expect("the simulation has finite times");
        println!("{} objects, {rollouts} rollouts: {} bytes", scene.objects.len(), bytes.len());
        criterion.bench_function(&format!("encode_{rollouts}_rollouts"), |b| {
            b.iter(|| encode(black_box(&recording)));
        });
        publish(criterion, &format!("store_{rollouts}_rollouts"), bytes);
    }
    gib();
}

/// The scene with copies of its objects, 20 m away, until there are [`OBJECTS`].
fn crowded(mut scene: Scene) -> Scene {
    for k in 0..OBJECTS.saturating_sub(scene.objects.len()) {
        let (mut object, mut track) = (scene.objects[k].clone(), scene.tracks[k].clone());
        object.id = 100 + k as u32;
        track.samples.iter_mut().for_each(|s| s.position.x += 20.0);
        scene.objects.push(object);
        scene.tracks.push(track);
    }
    scene
}

/// Stores the blob and its record durably, as the engine does.
fn publish(criterion: &mut Criterion, name: &str, bytes: Vec<u8>) {
    let folder = tempfile::tempdir().expect("there is room for temporary files");
    let store = Store::open(folder.path()).expect("a new folder can be opened");
    let runtime = tokio::runtime::Runtime::new().expect("threads can be started");
    let bytes = bytes::Bytes::from(bytes);
    let mut number = 0;
    criterion.bench_function(name, |b| {
        b.iter(|| {
            number += 1;
            runtime.block_on(async {
                store.put_blob(&number.to_string(), bytes.clone()).await?;
                store.put_lexicon(&number.to_string(), &"a record is about this long".repeat(10)).await
            })
        });
    });
}

/// Writes 1 GiB of states, plays all of it, and seeks; prints the times and the peak memory of the process.
fn gib() {
    let file = tempfile::NamedTempFile::new().expect("there is room for temporary files");
    write(file.as_file());
    let began = Instant::now();
    let mut reader = TraceReader::open(file.as_file()).expect("the file is whole");
    println!("1 GiB: open {:?}, {} chunks", began.elapsed(), reader.chunks());
    let (before, began) = (memory(), Instant::now());
    let played =
        reader.messages(&[&STATES.name], [0.0, MAX_TIME]).map(|m| m.is_ok()).filter(|ok| *ok).count();
    println!("1 GiB: {played} frames played in {:?}; memory {before} -> {} MiB", began.elapsed(), memory());
    let [from, to] = reader.span();
    let mut worst = std::time::Duration::ZERO;
    for k in 0..200 {
        let began = Instant::now();
        let at = from + (to - from) * f64::from(k * 37 % 200) / 200.0;
        assert!(reader.messages(&[&STATES.name], [at, MAX_TIME]).next().is_some_and(|m| m.is_ok()));
        worst = worst.max(began.elapsed());
    }
    println!("1 GiB: slowest of 200 seeks {worst:?}");
}

fn write(file: &File) {
    let options = mcap::WriteOptions::new().compression(None).chunk_size(Some(128 << 10));
    let mut writer = options.create(BufWriter::new(file)).expect("a temporary file can be written");
    let schema = writer.add_schema(STATES.schema, "protobuf", STATES.descriptors).expect("a new schema");
    let channel =
        writer.add_channel(schema, &STATES.name, "protobuf", &Default::default()).expect("a new channel");
    let state =
        v1::TraceState { x: 0.1, y: 0.2, vx: 0.3, vy: 0.4, yaw: 0.5, spin: 0.6, ..Default::default() };
    let row = v1::TraceFrame { frame: 1, time: 0.1, energy: 0.2, states: vec![state; 6] };
    let data = prost::Message::encode_to_vec(&row);
    for k in 0..GIB / data.len() as u64 {
        let log_time = k * 1_000_000;
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: k as u32,
            log_time,
            publish_time: log_time,
        };
        writer.write_to_known_channel(&header, &data).expect("a temporary file can be written");
    }
    writer.finish().expect("a temporary file can be written");
}

/// Peak memory of this process (MiB); 0 if the system does not report it.
fn memory() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) / 1024
}

criterion_group!(all, benches);
criterion_main!(all);
