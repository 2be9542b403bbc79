//! Tests of trace files: complete, deterministic, and safe to read when damaged.

use super::*;
use crate::num::vec2;
use crate::reason::LikelyEvent;
use crate::scene::{Object, Sample, Shape, Track, WorldKind};
use crate::world::{Event, EventKind, Intervention, Preset, trace};

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
    }
}

fn imagined(scene: &Scene) -> Imagined {
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
    Imagined {
        interventions: vec![Intervention::ScaleMass { id: 3, factor: 5.0 }],
        observed_frames: 20,
        sd: best.states.iter().map(|row| row.iter().map(|s| s.map(|_| 0.01)).collect()).collect(),
        model,
        best,
        ensemble: vec![],
        events: vec![event(EventKind::Collision, 0.5, &[0, 3]), event(EventKind::Stop, 0.91, &[6])],
        unreached: vec![],
        cut_short: None,
    }
}

fn check(change: impl Fn(&mut Imagined), then: impl Fn(&Imagined, Result<Vec<u8>, RecordingError>)) {
    let scene = scene();
    let mut imagined = imagined(&scene);
    change(&mut imagined);
    let estimates = [Estimate {
        scene: Some(0),
        name: "objects[0].mass".into(),
        value: 2.0,
        sd: 0.1,
        unit: "kg".into(),
        identified: true,
    }];
    let recording = Recording {
        scene: &scene,
        imagined: &imagined,
        estimates: &estimates,
        video: "videos/v",
        model: "m",
        seed: 7,
        request_json: "{\"frames\":30}",
    };
    then(&imagined, encode(&recording));
    if let (Ok(first), Ok(again)) = (encode(&recording), encode(&recording)) {
        assert_eq!(first, again, "equal recordings must give equal bytes");
    }
}

#[test]
fn every_frame_and_event_is_in_the_file() {
    check(
        |_| {},
        |imagined, bytes| {
            let reading = read(&bytes.unwrap()).unwrap();
            assert_eq!(reading.frames.len(), 30);
            for (frame, row) in reading.frames.iter().zip(&imagined.best.states) {
                assert_eq!(frame.time, imagined.best.times[frame.frame as usize]);
                let here: Vec<_> = row.iter().zip(&imagined.best.ids).filter(|(s, _)| s.is_some()).collect();
                assert_eq!(frame.states.len(), here.len());
                for (read, (state, id)) in frame.states.iter().zip(here) {
                    let state = state.unwrap();
                    assert_eq!((read.object_id, read.sd), (*id, Some(0.01)));
                    assert_eq!((read.x, read.y, read.yaw), (state.position.x, state.position.y, state.yaw));
                    assert_eq!(
                        (read.vx, read.vy, read.spin),
                        (state.velocity.x, state.velocity.y, state.spin)
                    );
                }
            }
            let events: Vec<_> =
                reading.events.iter().map(|e| (e.kind.as_str(), e.time, e.object_ids.clone())).collect();
            assert_eq!(events, [("collision", 0.5, vec![0, 3]), ("stop", 0.91, vec![6])]);
            let counts: Vec<_> = messages::TOPICS.iter().map(|t| reading.counts[t.name]).collect();
            assert_eq!(counts, [1, 20, 30, 30, 30, 30, 20, 2, 2]);
            assert_eq!(reading.parameters[0].value, 2.0);
            assert_eq!(reading.metadata["seed"], "7");
            assert_eq!(reading.attachments["request.json"], b"{\"frames\":30}");
            let model: crate::world::Model =
                serde_json::from_slice(&reading.attachments["model.json"]).unwrap();
            assert_eq!(trace(&model, &imagined.best.times), imagined.best, "a trace alone can be replayed");
        },
    );
}

#[test]
fn a_time_before_the_video_is_refused() {
    check(
        |imagined| imagined.best.times[0] = -1.0,
        |_, bytes| assert!(matches!(bytes, Err(RecordingError::Time { time: -1.0 }))),
    );
}

#[test]
fn a_damaged_file_gives_an_error_and_never_a_panic() {
    check(
        |_| {},
        |_, bytes| {
            let bytes = bytes.unwrap();
            for i in 0..200 {
                let cut = bytes.len() * i / 200;
                assert!(read(&bytes[..cut]).is_err(), "cut at {cut}");
                let mut flipped = bytes.clone();
                flipped[cut] ^= 1 << (i % 8);
                let _ = read(&flipped);
            }
        },
    );
}
