//! Computes again what a trace holds, from the trace alone, and compares.
//!
//! 1. Read scene, fit and request from the attachments.
//! 2. Simulate, and encode as the original program did.
//! 3. Compare the files byte by byte. If they differ (another program may have rewritten the file), compare message by
//!    message and report the largest difference of a number, and the messages or events that only one of the two has.

use super::messages::{self as m, v1};
use super::origin::{TOLERANCE, origin_difference};
use super::read::{Message, TraceReader};
use super::{RecordedChange, Recording, RecordingError, encode, encode_change};
use crate::fit::Fit;
use crate::media::Still;
use crate::num::Stop;
use crate::reason::{PredictionRequest, predict};
use crate::scene::Scene;
use crate::world::Model;
use prost::Message as _;
use serde::de::DeserializeOwned;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Cursor, Read, Seek};

/// Most rollouts that are simulated again: as many as a request may ask for.
const MAX_ROLLOUTS: usize = 1000;

/// The result of simulating again.
#[derive(Debug, Clone, PartialEq)]
pub struct Verification {
    /// `simulation`, `fit` or `discovery`.
    pub kind: String,
    /// The program that wrote the trace.
    pub build: String,
    /// Why the trace need not be equal bit for bit: another program or other arithmetic wrote it, as one sentence. `None`:
    /// all messages must be equal. Otherwise numbers must be equal within [`TOLERANCE`].
    pub origin_difference: Option<String>,
    /// Messages that were compared.
    pub messages: u64,
    /// Those that are not equal bit for bit.
    pub differing: u64,
    /// Whether the whole file is equal bit for bit.
    pub identical: bool,
    /// The largest difference of a number, if there is one.
    pub worst: Option<Difference>,
    /// Messages or events that only one of the two has.
    pub unmatched: u64,
}

/// Where a number differs most.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    pub topic: String,
    /// s.
    pub time: f64,
    pub what: String,
    pub recorded: f64,
    pub recomputed: f64,
}

impl Verification {
    pub fn holds(&self) -> bool {
        let near = self.worst.as_ref().is_none_or(|d| d.size() <= TOLERANCE);
        match self.origin_difference {
            // Another program may have rewritten the file, with the same messages.
            None => self.identical || self.differing == 0,
            Some(_) => self.unmatched == 0 && near,
        }
    }
}

impl Difference {
    pub fn size(&self) -> f64 {
        let size = (self.recorded - self.recomputed).abs();
        if size.is_nan() { f64::INFINITY } else { size }
    }
}

/// Simulates again and compares.
pub fn verify<R: Read + Seek>(source: R, stop: Stop) -> Result<Verification, RecordingError> {
    let mut recorded = TraceReader::open(source)?;
    let metadata = recorded.metadata()?;
    let bytes = recomputed(&mut recorded, &metadata, stop)?;
    let mut ours_file = TraceReader::open(Cursor::new(bytes.as_slice()))?;
    let mut found = Verification {
        kind: metadata.get("kind").cloned().unwrap_or_default(),
        build: metadata.get("build").cloned().unwrap_or_default(),
        origin_difference: origin_difference(&metadata),
        messages: 0,
        differing: 0,
        identical: recorded.has_content(&bytes)?,
        worst: None,
        unmatched: 0,
    };
    if found.identical {
        found.messages = recorded.topics().iter().map(|t| t.messages).sum();
        return Ok(found);
    }
    let ours: BTreeSet<String> = ours_file.topics().into_iter().map(|t| t.name).collect();
    let others: Vec<String> =
        recorded.topics().into_iter().map(|t| t.name).filter(|name| !ours.contains(name)).collect();
    // One pass for each topic of ours, and one for all others.
    recorded.allow_passes(1 + ours.len() as u64);
    if !others.is_empty() {
        let names: Vec<&str> = others.iter().map(String::as_str).collect();
        for message in recorded.messages(&names, [0.0, super::MAX_TIME]) {
            message?;
            found.messages += 1;
            found.differing += 1;
            found.unmatched += 1;
        }
    }
    for topic in ours {
        let (topic, all) = ([topic.as_str()], [0.0, super::MAX_TIME]);
        let (mut ours, mut theirs) = (ours_file.messages(&topic, all), recorded.messages(&topic, all));
        loop {
            match (theirs.next().transpose()?, ours.next().transpose()?) {
                (None, None) => break,
                (Some(a), Some(b)) => found.compare(&a, &b),
                _ => {
                    found.messages += 1;
                    found.differing += 1;
                    found.unmatched += 1;
                }
            }
        }
    }
    Ok(found)
}

/// The file as this program computes it.
fn recomputed<R: Read + Seek>(
    trace: &mut TraceReader<R>,
    metadata: &BTreeMap<String, String>,
    stop: Stop,
) -> Result<Vec<u8>, RecordingError> {
    let scene: Scene = json(trace, "scene.json")?;
    let fit: Fit = {
        let bytes = trace.attachment("fit.cbor")?.ok_or(RecordingError::Missing { what: "fit.cbor" })?;
        from_cbor(&bytes)?
    };
    let request_json = text(trace, "request.json")?;
    let word =
        |what: &'static str| metadata.get(what).map(String::as_str).ok_or(RecordingError::Missing { what });
    let number = |what: &'static str| word(what)?.parse().map_err(|_| RecordingError::Missing { what });
    let (video, model) = (word("video")?, word("model")?);
    if fit.scenes.first().is_none_or(|s| s.model.bodies.len() != scene.objects.len()) {
        return Err(RecordingError::Missing { what: "model of its scene" });
    }
    if word("kind")? != "simulation" {
        let before: Model = json(trace, "before.json")?;
        let revisions: Vec<super::RecordedRevision> = json(trace, "revisions.json")?;
        return encode_change(&RecordedChange {
            kind: word("kind")?,
            scene: &scene,
            before: &before,
            fit: &fit,
            video,
            model,
            revisions: &revisions,
            request_json: &request_json,
        });
    }
    let request = PredictionRequest {
        interventions: serde_json::from_str(word("interventions")?)?,
        frames: number("frames")?,
        rollouts: number("rollouts")?,
        seed: word("seed")?.parse().map_err(|_| RecordingError::Missing { what: "seed" })?,
    };
    if request.rollouts > MAX_ROLLOUTS {
        return Err(RecordingError::Missing { what: "number of rollouts that can be simulated" });
    }
    let prediction = predict(&scene, &fit, 0, &request, stop)?;
    let stills: Vec<Still> = match trace.attachment("stills.cbor")? {
        Some(bytes) => from_cbor(&bytes)?,
        None => vec![],
    };
    let (seed, stills) = (request.seed, stills.as_slice());
    let (scene, prediction, fit, request_json) = (&scene, &prediction, &fit, request_json.as_str());
    encode(&Recording { scene, prediction, fit, video, model, seed, request_json, stills })
}

fn from_cbor<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, RecordingError> {
    ciborium::from_reader(bytes).map_err(|e| RecordingError::Cbor(e.to_string()))
}

fn text<R: Read + Seek>(trace: &mut TraceReader<R>, what: &'static str) -> Result<String, RecordingError> {
    let bytes = trace.attachment(what)?.ok_or(RecordingError::Missing { what })?;
    String::from_utf8(bytes).map_err(|_| RecordingError::Missing { what })
}

fn json<T: DeserializeOwned, R: Read + Seek>(
    trace: &mut TraceReader<R>,
    what: &'static str,
) -> Result<T, RecordingError> {
    Ok(serde_json::from_str(&text(trace, what)?)?)
}

impl Verification {
    fn compare(&mut self, recorded: &Message, recomputed: &Message) {
        self.messages += 1;
        if recorded == recomputed {
            return;
        }
        self.differing += 1;
        let topic = &*recorded.topic;
        let numbers = if [m::STATES, m::BEFORE, m::AFTER].iter().any(|t| t.name == topic) {
            frames(recorded, recomputed)
        } else if m::EVENTS.name == topic {
            events(recorded, recomputed)
        } else {
            // Rows of other topics repeat these numbers.
            Some(vec![])
        };
        let Some(numbers) = numbers else {
            self.unmatched += 1;
            return;
        };
        for (what, a, b) in numbers {
            let (topic, time) = (topic.to_string(), recorded.time);
            let difference = Difference { topic, time, what, recorded: a, recomputed: b };
            if a != b && self.worst.as_ref().is_none_or(|worst| difference.size() > worst.size()) {
                self.worst = Some(difference);
            }
        }
    }
}

type NumberPairs = Vec<(String, f64, f64)>;

/// The numbers of two rows in pairs; `None` where the rows have different objects.
fn frames(a: &Message, b: &Message) -> Option<NumberPairs> {
    let row = |m: &Message| v1::TraceFrame::decode(m.data.as_slice()).ok();
    let (a, b) = (row(a)?, row(b)?);
    let ids = |row: &v1::TraceFrame| row.states.iter().map(|s| s.object_id).collect::<Vec<_>>();
    if ids(&a) != ids(&b) || a.frame != b.frame {
        return None;
    }
    let mut numbers = vec![("time".to_string(), a.time, b.time)];
    for (a, b) in a.states.iter().zip(&b.states) {
        let values = |s: &v1::TraceState| {
            [
                ("x", s.x),
                ("y", s.y),
                ("yaw", s.yaw),
                ("vx", s.vx),
                ("vy", s.vy),
                ("spin", s.spin),
                ("roll_x", s.roll_x),
                ("roll_y", s.roll_y),
            ]
        };
        for ((name, a_value), (_, b_value)) in values(a).into_iter().zip(values(b)) {
            numbers.push((format!("{name} of object {}", a.object_id), a_value, b_value));
        }
    }
    Some(numbers)
}

fn events(a: &Message, b: &Message) -> Option<NumberPairs> {
    let event = |m: &Message| v1::TraceEvent::decode(m.data.as_slice()).ok();
    let (a, b) = (event(a)?, event(b)?);
    let same = a.kind == b.kind && a.object_ids == b.object_ids && a.wall == b.wall;
    same.then(|| vec![(format!("time of a {}", a.kind), a.time, b.time)])
}
