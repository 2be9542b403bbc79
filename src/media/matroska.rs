//! Matroska and WebM: EBML elements to the coded frames of the first video track.
//!
//! An element is an id, a size (both of variable length: the leading zeros of the first byte give the length) and a payload. A
//! `Segment` holds `Info` (time stamp scale, ns), `Tracks` and `Cluster`s; a cluster has a time stamp and blocks, whose header
//! gives the track and a time relative to the cluster's. Sizes may be unknown (all ones): such a segment or cluster ends where an
//! element begins that it cannot hold. Source: RFC 8794 (EBML), RFC 9559 (Matroska).

use super::error::MediaError;
use super::limits::{MAX_ELEMENTS, MAX_VIDEO_FRAMES};
use super::mp4::avc_configuration;
use super::packets::{Codec, Packet, QuarterTurns, VideoTrack};

const SEGMENT: u64 = 0x1853_8067;
const INFO: u64 = 0x1549_A966;
const TIMESTAMP_SCALE: u64 = 0x2A_D7B1;
const TRACKS: u64 = 0x1654_AE6B;
const TRACK_ENTRY: u64 = 0xAE;
const TRACK_NUMBER: u64 = 0xD7;
const TRACK_TYPE: u64 = 0x83;
const CODEC_ID: u64 = 0x86;
const CODEC_PRIVATE: u64 = 0x63A2;
const CONTENT_ENCODINGS: u64 = 0x6D80;
const CLUSTER: u64 = 0x1F43_B675;
const CLUSTER_TIMESTAMP: u64 = 0xE7;
const SIMPLE_BLOCK: u64 = 0xA3;
const BLOCK_GROUP: u64 = 0xA0;
const BLOCK: u64 = 0xA1;

struct Element<'a> {
    id: u64,
    payload: &'a [u8],
    /// Offset of the payload in the file.
    start: usize,
}

/// A number of variable length at `at`: its value, with the length marker where `keep`, and its length. All ones are `u64::MAX`.
fn variable(bytes: &[u8], at: usize, keep: bool) -> Option<(u64, usize)> {
    let first = *bytes.get(at)?;
    let length = first.leading_zeros() as usize + 1;
    if length > 8 {
        return None;
    }
    let raw = bytes.get(at..at + length)?.iter().fold(0u64, |sum, &b| sum << 8 | u64::from(b));
    let marker = 1u64 << (7 * length);
    let value = if keep { raw } else { raw & (marker - 1) };
    Some((if !keep && value == marker - 1 { u64::MAX } else { value }, length))
}

/// The element at `at`; one of unknown size reaches to the end. A cut one is an error unless it may be (`Segment`, `Cluster`).
fn element<'a>(bytes: &'a [u8], base: usize, at: usize) -> Result<Option<(Element<'a>, usize)>, MediaError> {
    let Some((id, id_length)) = variable(bytes, at, true) else { return Ok(None) };
    let Some((size, size_length)) = variable(bytes, at + id_length, false) else { return Ok(None) };
    let start = at + id_length + size_length;
    let end = start.saturating_add(usize::try_from(size).unwrap_or(usize::MAX));
    let holds = matches!(id, SEGMENT | CLUSTER);
    if end > bytes.len() && !(holds || size == u64::MAX) {
        return Err(MediaError::truncated(format!("element {id:X}")));
    }
    let end = end.min(bytes.len());
    Ok(Some((Element { id, payload: &bytes[start..end], start: base + start }, end)))
}

fn elements(bytes: &[u8], base: usize) -> Result<Vec<Element<'_>>, MediaError> {
    let (mut found, mut at) = (vec![], 0);
    while let Some((next, end)) = element(bytes, base, at)? {
        found.push(next);
        at = end;
        if found.len() > MAX_ELEMENTS {
            return Err(MediaError::damaged("the file", "has too many elements"));
        }
    }
    Ok(found)
}

fn unsigned(payload: &[u8]) -> u64 {
    payload.iter().take(8).fold(0, |sum, &b| sum << 8 | u64::from(b))
}

#[derive(Default)]
struct Reading {
    /// Nanoseconds per time stamp.
    scale: u64,
    track: Option<(u64, Codec)>,
    packets: Vec<Packet>,
}

/// Reads a Matroska or WebM file.
pub(super) fn read(bytes: &[u8]) -> Result<VideoTrack, MediaError> {
    let top = elements(bytes, 0)?;
    let segment =
        top.iter().find(|e| e.id == SEGMENT).ok_or(MediaError::Missing { part: "element Segment" })?;
    let mut reading = Reading { scale: 1_000_000, ..Reading::default() };
    for part in elements(segment.payload, segment.start)? {
        match part.id {
            INFO => {
                for e in elements(part.payload, part.start)?.iter().filter(|e| e.id == TIMESTAMP_SCALE) {
                    reading.scale = unsigned(e.payload);
                }
            }
            TRACKS => reading.track = video_track(&part)?,
            CLUSTER => cluster(&part, &mut reading)?,
            _ => {}
        }
    }
    let Some((_, codec)) = reading.track else { return Err(MediaError::NoVideo) };
    if reading.packets.is_empty() {
        return Err(MediaError::Missing { part: "frames" });
    }
    let packets = reading.packets;
    Ok(VideoTrack { codec, packets, turns: QuarterTurns::None, pixel_aspect: None })
}

/// Number and codec of the first video track.
fn video_track(tracks: &Element) -> Result<Option<(u64, Codec)>, MediaError> {
    for entry in elements(tracks.payload, tracks.start)?.iter().filter(|e| e.id == TRACK_ENTRY) {
        let fields = elements(entry.payload, entry.start)?;
        let field = |id: u64| fields.iter().find(|e| e.id == id).map(|e| e.payload);
        if field(TRACK_TYPE).map(unsigned) != Some(1) {
            continue;
        }
        if field(CONTENT_ENCODINGS).is_some() {
            return Err(MediaError::Feature { what: "compressed or encrypted Matroska tracks".into() });
        }
        let number = field(TRACK_NUMBER).map_or(1, unsigned);
        let id = String::from_utf8_lossy(field(CODEC_ID).unwrap_or(b"none")).into_owned();
        return match id.as_str() {
            "V_MPEG4/ISO/AVC" => {
                let config =
                    field(CODEC_PRIVATE).ok_or(MediaError::Missing { part: "element CodecPrivate" })?;
                Ok(Some((number, avc_configuration(config)?)))
            }
            "V_MJPEG" => Ok(Some((number, Codec::Jpeg))),
            _ => Err(MediaError::Codec { codec: id.chars().filter(|c| !c.is_control()).take(40).collect() }),
        };
    }
    Ok(None)
}

fn cluster(cluster: &Element, reading: &mut Reading) -> Result<(), MediaError> {
    let (mut at, mut time) = (0, 0u64);
    while let Some((e, end)) = element(cluster.payload, cluster.start, at)? {
        match e.id {
            CLUSTER_TIMESTAMP => time = unsigned(e.payload),
            SIMPLE_BLOCK => block(&e, time, reading)?,
            BLOCK_GROUP => {
                for inner in elements(e.payload, e.start)?.iter().filter(|i| i.id == BLOCK) {
                    block(inner, time, reading)?;
                }
            }
            // A cluster of unknown size held all that follows.
            CLUSTER => {
                at = at.max(e.start - cluster.start);
                time = 0;
                continue;
            }
            _ => {}
        }
        at = end;
    }
    Ok(())
}

fn block(block: &Element, cluster_time: u64, reading: &mut Reading) -> Result<(), MediaError> {
    let cut = || MediaError::truncated("a block");
    let (track, length) = variable(block.payload, 0, false).ok_or_else(cut)?;
    let header = block.payload.get(length..length + 3).ok_or_else(cut)?;
    if reading.track.as_ref().is_none_or(|(number, _)| *number != track) {
        return Ok(());
    }
    if header[2] & 0x06 != 0 {
        return Err(MediaError::Feature { what: "laced video blocks".into() });
    }
    if reading.packets.len() >= MAX_VIDEO_FRAMES {
        return Err(MediaError::TooManyFrames { given: reading.packets.len() + 1 });
    }
    let stamp = i64::try_from(cluster_time).unwrap_or(i64::MAX);
    let order = stamp.saturating_add(i64::from(i16::from_be_bytes([header[0], header[1]])));
    reading.packets.push(Packet {
        offset: block.start + length + 3,
        size: block.payload.len() - length - 3,
        time: Some(order as f64 * reading.scale as f64 * 1e-9),
        order,
    });
    Ok(())
}
