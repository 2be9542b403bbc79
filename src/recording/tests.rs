//! Tests of trace files: complete, deterministic, replayed bit for bit, and safe to read when damaged.

use super::*;
use crate::fit::{FitOptions, fit, initial_model};
use crate::media::VideoFrame;
use crate::num::{NUMERIC_FINGERPRINT, never, vec2};
use crate::reason::{LikelyEvent, PredictionRequest, predict};
use crate::scene::{Object, Sample, Shape, Track, WorldKind};
use crate::world::{Event, EventKind, Intervention, Preset, trace};
use prost::Message as _;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::LazyLock;

fn scene() -> Scene {
    let shapes = [
        Shape::Disc { radius: 0.2 },
        Shape::Ball { radius: 0.2 },
        Shape::Square { half_side: 0.2 },
        Shape::Rectangle { half_length: 0.3, half_width: 0.1 },
    ];
    let object = |(i, shape): (usize, Shape)| Object {
        id: 3 * i as u32,
        color: ["red", "blue", "green", "pink"][i].into(),
        material: "rubber".into(),
        shape,
        mass: None,
        features: vec![],
    };
    let track = |i: usize| Track {
        samples: (i..20)
            .map(|frame| Sample {
                frame,
                position: vec2(i as f64, 0.01 * frame as f64),
                yaw: None,
                covariance: None,
            })
            .collect(),
    };
    Scene {
        name: "four".into(),
        setup: None,
        world: WorldKind::Clevrer,
        fps: 25.0,
        times: (0..20).map(|f| f as f64 / 25.0).collect(),
        camera: None,
        table: None,
        noise_sigma: None,
        objects: shapes.into_iter().enumerate().map(object).collect(),
        tracks: (0..4).map(track).collect(),
        outliers: vec![],
        findings: vec![],
        feature_layout: None,
        absent: vec![],
    }
}

fn prediction(scene: &Scene) -> Prediction {
    let model = Preset::for_world(scene.world).model(scene);
    let times: Vec<f64> = (0..30).map(|f| scene.time_of(f)).collect();
    let best = trace(&model, &times);
    let event = |kind, time, objects: &[u32]| LikelyEvent {
        event: Event {
            kind,
            time,
            objects: objects.to_vec(),
            position: vec2(0.1, 0.2),
            normal: (kind == EventKind::Collision).then(|| vec2(1.0, 0.0)),
            impulse: None,
            wall: None,
        },
        frame: scene.frame_at(time),
        probability: 0.75,
    };
    Prediction {
        interventions: vec![Intervention::ScaleMass { id: 3, factor: 5.0 }],
        observed_frames: 20,
        sd: best.states.iter().map(|row| row.iter().map(|s| s.map(|_| 0.01)).collect()).collect(),
        model,
        ensemble: vec![best.clone(), best.clone()],
        best,
        events: vec![event(EventKind::Collision, 0.5, &[0, 3]), event(EventKind::Stop, 0.91, &[6])],
        unreached: vec![],
        cut_short: None,
    }
}

/// The scene, fitted once.
static FITTED: LazyLock<(Scene, Fit)> = LazyLock::new(|| {
    let scene = scene();
    let model = Preset::for_world(scene.world).model(&scene);
    let fit = fit(std::slice::from_ref(&scene), &[model], &FitOptions::default(), &never).unwrap();
    (scene, fit)
});

fn encoded(prediction: &Prediction) -> Result<Vec<u8>, RecordingError> {
    let (scene, fit) = &*FITTED;
    let request_json = "{\"frames\":30}";
    let (video, model, seed, stills) = ("v", "m", 7, [].as_slice());
    encode(&Recording { scene, prediction, fit, video, model, seed, request_json, stills })
}

/// A simulation as the service computes it, then altered by `change`.
fn simulation(frames: usize, change: impl Fn(&mut Prediction)) -> Vec<u8> {
    let (scene, fit) = &*FITTED;
    let interventions = vec![Intervention::ScaleMass { id: 3, factor: 5.0 }];
    let request = PredictionRequest { interventions, frames, rollouts: 3, seed: 7 };
    let mut prediction = predict(scene, fit, 0, &request, &never).unwrap();
    change(&mut prediction);
    encoded(&prediction).unwrap()
}

fn change() -> Vec<u8> {
    let (scene, fit) = &*FITTED;
    let before = initial_model(scene, &Preset::for_world(scene.world).model(scene));
    let step =
        RecordedRevision { effect: "tilt".into(), rmse: 0.1, held_out_rmse: 0.2, reduced_chi_square: 3.0 };
    let revisions = [step];
    encode_change(&RecordedChange {
        kind: "discovery",
        scene,
        before: &before,
        fit,
        video: "v",
        model: "m",
        revisions: &revisions,
        request_json: "{}",
    })
    .unwrap()
}

#[test]
fn stills_are_shown_with_outlines_and_simulated_again() {
    let (scene, fit) = &*FITTED;
    let scene = &Scene { camera: Some(crate::perception::top_camera(0.01, [960.0, 640.0])), ..scene.clone() };
    let size = [960, 640];
    let frame = |index| VideoFrame { index, time: 0.0, size, rgb: vec![90; 3 * size[0] * size[1]] };
    let stills: Vec<Still> = [0, 10, 19].into_iter().filter_map(|k| Still::of(&frame(k))).collect();
    let request = PredictionRequest { interventions: vec![], frames: 30, rollouts: 1, seed: 7 };
    let prediction = &predict(scene, fit, 0, &request, &never).unwrap();
    let (video, model, seed, request_json) = ("v", "m", 7, "{}");
    let of = |stills| Recording { scene, prediction, fit, video, model, seed, request_json, stills };
    let bytes = encode(&of(&stills)).unwrap();
    let found = verify(Cursor::new(bytes.as_slice()), &never).unwrap();
    assert!(found.holds() && found.identical, "{found:?}");
    let reading = read(&bytes).unwrap();
    assert_eq!((reading.counts["/camera/image"], reading.counts["/camera/annotations"]), (3, 3));
    let mut file = TraceReader::open(Cursor::new(bytes.as_slice())).unwrap();
    let first = file.messages(&["/camera/annotations"], [0.0, 1.0]).next().unwrap().unwrap();
    let drawn = messages::foxglove::ImageAnnotations::decode(first.data.as_slice()).unwrap();
    // In frame 0 one of the objects was measured; the picture has half the size of the frame.
    assert_eq!(drawn.texts.len(), 1);
    let corners = &drawn.points[0].points;
    let middle = corners.iter().map(|p| p.x).sum::<f64>() / corners.len() as f64;
    let x = scene.tracks[0].samples[0].position.x;
    assert!((middle - 0.5 * (480.0 + 100.0 * x)).abs() < 0.1, "{middle} {x}");
    // Without stills the file is what it was before there were any.
    let without = read(&encode(&of(&[])).unwrap()).unwrap();
    assert!(without.counts.keys().all(|topic| !topic.starts_with("/camera")));
    assert!(!without.attachments.contains_key("stills.cbor"));
}

#[test]
fn every_frame_and_event_is_in_the_file() {
    let prediction = prediction(&FITTED.0);
    let bytes = encoded(&prediction).unwrap();
    assert_eq!(bytes, encoded(&prediction).unwrap(), "equal recordings must give equal bytes");
    let reading = read(&bytes).unwrap();
    assert_eq!(reading.frames.len(), 30);
    for (frame, row) in reading.frames.iter().zip(&prediction.best.states) {
        assert_eq!(frame.time, prediction.best.times[frame.frame as usize]);
        let here: Vec<_> = row.iter().zip(&prediction.best.ids).filter(|(s, _)| s.is_some()).collect();
        assert_eq!(frame.states.len(), here.len());
        for (read, (state, id)) in frame.states.iter().zip(here) {
            let state = state.unwrap();
            assert_eq!((read.object_id, read.sd), (*id, Some(0.01)));
            assert_eq!((read.x, read.y, read.yaw), (state.position.x, state.position.y, state.yaw));
            assert_eq!((read.vx, read.vy, read.spin), (state.velocity.x, state.velocity.y, state.spin));
        }
    }
    let events: Vec<_> =
        reading.events.iter().map(|e| (e.kind.as_str(), e.time, e.object_ids.clone())).collect();
    assert_eq!(events, [("collision", 0.5, vec![0, 3]), ("stop", 0.91, vec![6])]);
    let counts: Vec<_> = messages::SIMULATION.iter().map(|t| reading.counts[&*t.name]).collect();
    // Shapes at the frames 0 and 25, and where three come in.
    assert_eq!(counts, [1, 20, 30, 5, 30, 30, 20, 2, 2]);
    for topic in ["/ensemble/mean", "/ensemble/mean/poses", "/ensemble/rollouts"] {
        assert_eq!(reading.counts[topic], 30, "{topic}");
    }
    assert_eq!(reading.parameters.len(), FITTED.1.posterior.estimates.len());
    assert_eq!(reading.metadata["seed"], "7");
    assert_eq!(reading.attachments["request.json"], b"{\"frames\":30}");
    let model: crate::world::Model = serde_json::from_slice(&reading.attachments["model.json"]).unwrap();
    assert_eq!(trace(&model, &prediction.best.times), prediction.best, "a trace alone can be replayed");
}

#[test]
fn a_time_before_the_video_is_refused() {
    let mut prediction = prediction(&FITTED.0);
    prediction.best.times[0] = -1.0;
    assert!(matches!(encoded(&prediction), Err(RecordingError::Time { time: -1.0 })));
}

#[test]
fn a_change_holds_both_models_and_the_loss_of_each_iteration() {
    let reading = read(&change()).unwrap();
    let losses = &FITTED.1.losses;
    assert!(losses.len() > 1 && losses.last() < losses.first(), "{losses:?}");
    let counts: Vec<_> = messages::CHANGE.iter().map(|t| reading.counts[&*t.name]).collect();
    assert_eq!(counts, [1, 20, 20, 20, 20, 20, 20, 20, losses.len(), 1]);
}

#[test]
fn a_trace_alone_gives_the_same_bytes_again() {
    for bytes in [simulation(30, |_| {}), change()] {
        let found = verify(Cursor::new(&bytes), &never).unwrap();
        assert!(
            found.holds() && found.identical && found.origin_difference.is_none() && found.messages > 100,
            "{found:?}"
        );
        // As if another build had written it: then numbers are compared.
        let build = build();
        let at = bytes.windows(build.len()).position(|w| w == build.as_bytes()).unwrap();
        let mut other = bytes.clone();
        other[at] = b'9';
        let found = verify(Cursor::new(&other), &never).unwrap();
        assert!(
            found.holds() && !found.identical && found.origin_difference.is_some() && found.worst.is_none(),
            "{found:?}"
        );
    }
}

#[test]
fn a_trace_of_other_arithmetic_is_named_as_such() {
    let bytes = simulation(30, |_| {});
    let ours = NUMERIC_FINGERPRINT.as_bytes();
    let at = bytes.windows(ours.len()).position(|w| w == ours).unwrap();
    let mut other = bytes.clone();
    other[at] ^= 1;
    let found = verify(Cursor::new(&other), &never).unwrap();
    let sentence = found.origin_difference.clone().unwrap();
    assert!(
        sentence.contains("other arithmetic") && sentence.contains(NUMERIC_FINGERPRINT.as_str()),
        "{sentence}"
    );
    assert!(found.holds() && !found.identical, "{found:?}");
}

#[test]
fn an_altered_trace_is_found() {
    let nudged = |by: f64| simulation(30, |i| i.best.states[5][0].as_mut().unwrap().position.x += by);
    for by in [1e-3, 1e-12] {
        let found = verify(Cursor::new(nudged(by)), &never).unwrap();
        let worst = found.worst.clone().unwrap();
        assert!(!found.holds() && worst.what == "x of object 0", "{found:?}");
        assert!((worst.size() - by).abs() < 0.1 * by && (worst.time - 0.2).abs() < 1e-9, "{worst:?}");
    }
    let missing = simulation(30, |i| i.best.states[5][0] = None);
    assert!(verify(Cursor::new(missing), &never).unwrap().unmatched > 0);
}

#[test]
fn any_time_span_is_read_through_the_index() {
    let bytes = simulation(400, |_| {});
    let mut reader = TraceReader::open(Cursor::new(&bytes)).unwrap();
    assert!(reader.chunks() > 3);
    let topic = [&*messages::STATES.name];
    let mut times = |span| -> Vec<f64> { reader.messages(&topic, span).map(|m| m.unwrap().time).collect() };
    let all = times([0.0, MAX_TIME]);
    assert!(all.len() == 400 && all.is_sorted());
    for span in [[0.0, 0.0], [3.0, 5.0], [15.9, 99.0], [99.0, 100.0]] {
        let wanted: Vec<f64> = all.iter().copied().filter(|t| (span[0]..=span[1]).contains(t)).collect();
        assert_eq!(times(span), wanted);
    }
    let scanned = read(&bytes).unwrap();
    assert_eq!(reader.metadata().unwrap(), scanned.metadata);
    for (name, content) in scanned.attachments {
        assert_eq!(reader.attachment(&name).unwrap(), Some(content));
    }
    assert_eq!(reader.attachment("nothing").unwrap(), None);
    let counted =
        reader.topics().into_iter().filter(|t| t.messages > 0).map(|t| (t.name, t.messages as usize));
    assert_eq!(counted.collect::<BTreeMap<_, _>>(), scanned.counts);
}

/// Topic, time and content of a message.
type Salvaged = (String, u64, Vec<u8>);

/// What is read from a damaged file.
fn salvaged(bytes: &[u8]) -> Option<(ScanReport, Vec<Salvaged>)> {
    let mut messages = vec![];
    let report = scan(Cursor::new(bytes), &mut |item| {
        if let scan::ScannedItem::Message { topic, header, data } = item {
            messages.push((topic.to_string(), header.log_time, data.to_vec()));
        }
    });
    report.ok().map(|report| (report, messages))
}

#[test]
fn every_whole_chunk_of_a_damaged_file_is_read_without_a_panic() {
    let bytes = simulation(400, |_| {});
    let (report, messages) = salvaged(&bytes).unwrap();
    assert!(report.is_whole() && report.chunks > 3, "{report:?}");
    let summary =
        scan::Summary::read(&mut scan::FileWindow::new(Cursor::new(&bytes)).unwrap()).unwrap().unwrap();
    let ends: Vec<u64> = summary.chunks.iter().map(|c| c.chunk_start_offset + c.chunk_length).collect();
    for i in 0..200 {
        let cut = bytes.len() * i / 200;
        assert!(read(&bytes[..cut]).is_err() && TraceReader::open(Cursor::new(&bytes[..cut])).is_err());
        let Some((part, _)) = salvaged(&bytes[..cut]) else {
            assert!(cut < 8, "cut at {cut}");
            continue;
        };
        let whole = ends.iter().filter(|end| **end <= cut as u64).count();
        assert!(!part.is_whole() && part.chunks == whole, "cut at {cut}: {part:?}");
    }
    // Bits all over the file, and those of the first bytes, of the index and of the end one by one.
    let spread = (0..700).map(|i| 8 * bytes.len() / 700 * i + i % 8);
    let edges = (0..150).chain(8 * bytes.len() - 150..8 * bytes.len());
    for bit in spread.chain(edges) {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        let Some((part, found)) = salvaged(&flipped) else { panic!("bit {bit}: nothing was read") };
        assert!(!part.is_whole(), "bit {bit} was not noticed");
        assert!(part.chunks + 1 >= report.chunks, "bit {bit}: {part:?}");
        if part.chunks == report.chunks {
            assert_eq!(found, messages, "bit {bit}");
        } else {
            assert!(found.iter().all(|m| messages.binary_search_by_key(&m.1, |n| n.1).is_ok()), "bit {bit}");
            let stated: u64 = part.stated.unwrap().values().sum();
            assert!(stated as usize == messages.len() && found.len() < messages.len(), "bit {bit}");
        }
        let _ =
            TraceReader::open(Cursor::new(&flipped)).map(|mut r| r.messages(&[], [0.0, MAX_TIME]).count());
        let _ = read(&flipped);
    }
    // Many at once.
    for seed in 0..20u64 {
        let mut flipped = bytes.clone();
        for k in 0..1000u64 {
            let at = (seed * 7919 + k).wrapping_mul(0x9E37_79B9_7F4A_7C15) as usize % flipped.len();
            flipped[at] ^= 1 << (k % 8);
        }
        let _ = salvaged(&flipped);
        let _ = verify(Cursor::new(&flipped), &never);
    }
}
