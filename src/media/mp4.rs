//! MP4 and MOV: boxes to the coded frames of the first video track.
//!
//! A file is a tree of boxes (size, four-character code, payload). `moov` describes the tracks; the sample tables of a track
//! (`stts` durations, `ctts` composition offsets, `stsz` sizes, `stsc` and `stco` places) give each sample its bytes and its
//! composition time `c` in units of the track's time scale. Fragmented files continue in `moof` boxes (`trun`). An edit list
//! (`elst`) maps composition time to presentation time: an edit with media time m shows `c >= m` at `start + (c - m)`; an empty
//! edit delays what follows. Sources: ISO/IEC 14496-12 (2015), sections 8.3-8.8; 14496-15 for `avcC`; QuickTime File Format.

use super::bytes::{Cursor, code};
use super::error::MediaError;
use super::limits::{MAX_ELEMENTS, MAX_VIDEO_FRAMES};
use super::packets::{Codec, Packet, QuarterTurns, VideoTrack};

/// One box: its code, its payload and the offset of its header in the file.
struct Mp4Box<'a> {
    kind: [u8; 4],
    payload: &'a [u8],
    start: usize,
    /// Whether the file ends before the box does.
    cut: bool,
}

/// The boxes side by side in `bytes`, which begin at `base` in the file.
fn boxes(bytes: &[u8], base: usize) -> Result<Vec<Mp4Box<'_>>, MediaError> {
    let (mut found, mut at) = (vec![], 0usize);
    while bytes.len() - at >= 8 {
        let mut header = Cursor::new(&bytes[at..], "a box header");
        let (short, kind) = (header.u32()? as u64, header.four()?);
        let (size, length) = match short {
            0 => ((bytes.len() - at) as u64, 8),
            1 => (header.u64()?, 16),
            size => (size, 8),
        };
        if size < length as u64 {
            return Err(MediaError::damaged(format!("box {}", code(kind)), format!("has the size {size}")));
        }
        let end = at.saturating_add(usize::try_from(size).unwrap_or(usize::MAX));
        let cut = end > bytes.len();
        found.push(Mp4Box {
            kind,
            payload: &bytes[(at + length).min(bytes.len())..end.min(bytes.len())],
            start: base + at,
            cut,
        });
        if found.len() > MAX_ELEMENTS {
            return Err(MediaError::damaged("the file", "has too many boxes"));
        }
        at = end.min(bytes.len());
    }
    Ok(found)
}

fn child<'a>(bytes: &'a [u8], kind: &[u8; 4]) -> Result<Option<&'a [u8]>, MediaError> {
    Ok(boxes(bytes, 0)?.into_iter().find(|b| &b.kind == kind).map(|b| b.payload))
}

/// The payload of nested boxes.
fn path<'a>(bytes: &'a [u8], kinds: &[&[u8; 4]]) -> Result<Option<&'a [u8]>, MediaError> {
    let mut at = bytes;
    for kind in kinds {
        match child(at, kind)? {
            Some(inner) => at = inner,
            None => return Ok(None),
        }
    }
    Ok(Some(at))
}

fn needed<'a>(bytes: &'a [u8], kinds: &[&[u8; 4]], part: &'static str) -> Result<&'a [u8], MediaError> {
    path(bytes, kinds)?.ok_or(MediaError::Missing { part })
}

/// A sample of the track's tables, in units of its time scale.
#[derive(Clone, Copy)]
struct TableSample {
    offset: u64,
    size: u32,
    composition: i64,
    duration: u32,
}

/// Reads an MP4 or MOV file.
pub(super) fn read(bytes: &[u8]) -> Result<VideoTrack, MediaError> {
    let top = boxes(bytes, 0)?;
    let Some(moov) = top.iter().find(|b| &b.kind == b"moov") else {
        let cut = top.iter().any(|b| b.cut);
        return Err(if cut {
            MediaError::truncated("box mdat")
        } else {
            MediaError::Missing { part: "box moov" }
        });
    };
    if moov.cut {
        return Err(MediaError::truncated("box moov"));
    }
    let moov = moov.payload;
    let track = boxes(moov, 0)?
        .into_iter()
        .filter(|b| &b.kind == b"trak")
        .map(|b| b.payload)
        .find(|trak| is_video(trak))
        .ok_or(MediaError::NoVideo)?;
    let (id, turns) = header(needed(track, &[b"tkhd"], "box tkhd")?)?;
    let media = needed(track, &[b"mdia"], "box mdia")?;
    let scale = time_scale(needed(media, &[b"mdhd"], "box mdhd")?)?;
    let tables = needed(media, &[b"minf", b"stbl"], "box stbl")?;
    let (codec, pixel_aspect) = description(needed(tables, &[b"stsd"], "box stsd")?)?;
    let mut samples = table_samples(tables)?;
    let defaults = fragment_defaults(moov, id)?;
    for moof in top.iter().filter(|b| &b.kind == b"moof") {
        fragment(moof, id, defaults, &mut samples)?;
    }
    if samples.is_empty() {
        return Err(MediaError::Missing { part: "frames" });
    }
    let movie_scale = match child(moov, b"mvhd")? {
        Some(mvhd) => time_scale(mvhd)?,
        None => scale,
    };
    let edits = match path(track, &[b"edts", b"elst"])? {
        Some(list) => edit_list(list)?,
        None => vec![],
    };
    let packet = |s: &TableSample| {
        let within = |v: u64| usize::try_from(v).unwrap_or(usize::MAX);
        let time = presented(s, &edits, scale, movie_scale);
        Packet { offset: within(s.offset), size: s.size as usize, time, order: s.composition }
    };
    Ok(VideoTrack { codec, packets: samples.iter().map(packet).collect(), turns, pixel_aspect })
}

fn is_video(trak: &[u8]) -> bool {
    let handler = path(trak, &[b"mdia", b"hdlr"]).ok().flatten();
    handler.and_then(|h| h.get(8..12)).is_some_and(|kind| kind == b"vide")
}

/// VideoTrack id and rotation of `tkhd`.
fn header(tkhd: &[u8]) -> Result<(u32, QuarterTurns), MediaError> {
    let mut at = Cursor::new(tkhd, "box tkhd");
    let version = at.u8()?;
    at.skip(if version == 1 { 19 } else { 11 })?;
    let id = at.u32()?;
    at.skip(if version == 1 { 12 } else { 8 } + 16)?;
    let (a, b) = (at.i32()?, at.i32()?);
    at.skip(4)?;
    let (c, d) = (at.i32()?, at.i32()?);
    // The matrix maps decoded to shown coordinates: (x, y) -> (a x + c y, b x + d y), y down.
    Ok((
        id,
        match (a.signum(), b.signum(), c.signum(), d.signum()) {
            (0, 1, -1, 0) => QuarterTurns::Quarter,
            (-1, 0, 0, -1) => QuarterTurns::Half,
            (0, -1, 1, 0) => QuarterTurns::ThreeQuarters,
            (1, 0, 0, 1) | (0, 0, 0, 0) => QuarterTurns::None,
            _ => return Err(MediaError::Feature { what: "a mirrored or sheared track matrix".into() }),
        },
    ))
}

/// Units per second of `mdhd` or `mvhd`.
fn time_scale(bytes: &[u8]) -> Result<f64, MediaError> {
    let mut at = Cursor::new(bytes, "box mdhd");
    let version = at.u8()?;
    at.skip(if version == 1 { 19 } else { 11 })?;
    match at.u32()? {
        0 => Err(MediaError::damaged("box mdhd", "has the time scale 0")),
        scale => Ok(f64::from(scale)),
    }
}

/// Codec and pixel aspect of the first sample description.
fn description(stsd: &[u8]) -> Result<(Codec, Option<f64>), MediaError> {
    let mut at = Cursor::new(stsd, "box stsd");
    at.skip(8)?;
    let entries = boxes(at.rest(), 0)?;
    let entry = entries.first().ok_or(MediaError::Missing { part: "a sample description in box stsd" })?;
    // A visual sample entry has 78 bytes before its boxes.
    let inner = entry.payload.get(78..).unwrap_or(&[]);
    match &entry.kind {
        b"avc1" | b"avc3" => {
            let config = needed(inner, &[b"avcC"], "box avcC")?;
            Ok((avc_configuration(config)?, child(inner, b"pasp")?.and_then(aspect)))
        }
        b"jpeg" | b"mjpa" | b"mjpg" => Ok((Codec::Jpeg, None)),
        b"encv" | b"drmi" => {
            let scheme =
                path(inner, &[b"sinf", b"schm"])?.and_then(|s| s.get(4..8)).and_then(|s| s.try_into().ok());
            Err(MediaError::Encrypted { scheme: scheme.map_or("unknown scheme".into(), code) })
        }
        kind => Err(MediaError::Codec { codec: codec_name(*kind) }),
    }
}

fn codec_name(kind: [u8; 4]) -> String {
    let name = match &kind {
        b"hvc1" | b"hev1" | b"dvh1" | b"dvhe" => "HEVC (H.265)",
        b"av01" => "AV1",
        b"vp08" => "VP8",
        b"vp09" => "VP9",
        b"mp4v" => "MPEG-4 part 2",
        b"apch" | b"apcn" | b"apcs" | b"apco" | b"ap4h" | b"ap4x" => "Apple ProRes",
        b"s263" | b"h263" => "H.263",
        _ => return code(kind),
    };
    format!("{name} ({})", code(kind))
}

fn aspect(pasp: &[u8]) -> Option<f64> {
    let mut at = Cursor::new(pasp, "box pasp");
    let (h, v) = (at.u32().ok()?, at.u32().ok()?);
    (h > 0 && v > 0).then(|| f64::from(h) / f64::from(v))
}

/// `avcC`: the length of lengths, and the parameter sets.
pub(super) fn avc_configuration(bytes: &[u8]) -> Result<Codec, MediaError> {
    let mut at = Cursor::new(bytes, "box avcC");
    at.skip(4)?;
    let length_bytes = usize::from(at.u8()? & 3) + 1;
    let mut parameter_sets = vec![];
    for mask in [0x1f, 0xff] {
        for _ in 0..at.u8()? & mask {
            let size = usize::from(at.u16()?);
            parameter_sets.push(at.take(size)?.to_vec());
        }
    }
    Ok(Codec::H264 { length_bytes, parameter_sets })
}

/// Entries of a table of runs `(count, value)` after version and flags.
fn runs(bytes: &[u8], part: &'static str) -> Result<Vec<(u32, u32)>, MediaError> {
    let mut at = Cursor::new(bytes, part);
    at.skip(4)?;
    let count = at.u32()? as usize;
    (0..count.min(at.rest().len() / 8)).map(|_| Ok((at.u32()?, at.u32()?))).collect()
}

/// The values of a table of runs, one by one; the last run goes on.
struct RunValues(Vec<(u32, u32)>, usize, u32);

impl RunValues {
    fn next(&mut self) -> u32 {
        while let Some(&(count, value)) = self.0.get(self.1) {
            if self.2 < count {
                self.2 += 1;
                return value;
            }
            (self.1, self.2) = (self.1 + 1, 0);
        }
        self.0.last().map_or(0, |run| run.1)
    }
}

/// Sizes of the samples (bytes).
fn sizes(tables: &[u8]) -> Result<Vec<u32>, MediaError> {
    let Some(stsz) = child(tables, b"stsz")? else {
        let compact = child(tables, b"stz2")?.is_some();
        let feature = MediaError::Feature { what: "compact sample sizes (box stz2)".into() };
        return if compact { Err(feature) } else { Err(MediaError::Missing { part: "box stsz" }) };
    };
    let mut at = Cursor::new(stsz, "box stsz");
    at.skip(4)?;
    let (common, count) = (at.u32()?, at.u32()? as usize);
    if count > MAX_VIDEO_FRAMES {
        return Err(MediaError::TooManyFrames { given: count });
    }
    (0..count).map(|_| if common > 0 { Ok(common) } else { at.u32() }).collect()
}

/// Offsets of the chunks in the file.
fn chunk_offsets(tables: &[u8]) -> Result<Vec<u64>, MediaError> {
    let (bytes, wide) = match (child(tables, b"stco")?, child(tables, b"co64")?) {
        (Some(bytes), _) => (bytes, false),
        (_, Some(bytes)) => (bytes, true),
        _ => return Err(MediaError::Missing { part: "box stco" }),
    };
    let mut at = Cursor::new(bytes, "box stco");
    at.skip(4)?;
    let count = (at.u32()? as usize).min(at.rest().len() / 4).min(MAX_ELEMENTS);
    (0..count).map(|_| if wide { at.u64() } else { at.u32().map(u64::from) }).collect()
}

/// The samples of the tables of an unfragmented track.
fn table_samples(tables: &[u8]) -> Result<Vec<TableSample>, MediaError> {
    let sizes = sizes(tables)?;
    if sizes.is_empty() {
        return Ok(vec![]);
    }
    let chunks = chunk_offsets(tables)?;
    let mut at = Cursor::new(needed(tables, &[b"stsc"], "box stsc")?, "box stsc");
    at.skip(4)?;
    let count = (at.u32()? as usize).min(at.rest().len() / 12);
    let mut per_chunk: Vec<(u32, u32)> = vec![];
    for _ in 0..count {
        per_chunk.push((at.u32()?, at.u32()?));
        at.skip(4)?;
    }
    let mut durations = RunValues(runs(needed(tables, &[b"stts"], "box stts")?, "box stts")?, 0, 0);
    let mut shifts = match child(tables, b"ctts")? {
        Some(ctts) => Some(RunValues(runs(ctts, "box ctts")?, 0, 0)),
        None => None,
    };
    let (mut samples, mut decode) = (vec![], 0i64);
    for (chunk, &start) in chunks.iter().enumerate() {
        let run = per_chunk.partition_point(|run| run.0 as usize <= chunk + 1);
        let Some(&(_, samples_here)) = run.checked_sub(1).and_then(|r| per_chunk.get(r)) else { continue };
        let mut offset = start;
        for _ in 0..samples_here {
            let Some(&size) = sizes.get(samples.len()) else { return Ok(samples) };
            let duration = durations.next();
            // Version 0 is unsigned by the standard, but writers put signed offsets there, too; both are read as signed.
            let shift = shifts.as_mut().map_or(0, |s| i64::from(s.next() as i32));
            samples.push(TableSample { offset, size, composition: decode + shift, duration });
            (offset, decode) = (offset.saturating_add(u64::from(size)), decode + i64::from(duration));
        }
    }
    if samples.len() < sizes.len() {
        return Err(MediaError::damaged(
            "box stsc",
            format!("places {} of {} samples", samples.len(), sizes.len()),
        ));
    }
    Ok(samples)
}

/// Default duration and size of a fragment's samples, from `trex`.
fn fragment_defaults(moov: &[u8], id: u32) -> Result<[u32; 2], MediaError> {
    let Some(mvex) = child(moov, b"mvex")? else { return Ok([0, 0]) };
    for trex in boxes(mvex, 0)?.into_iter().filter(|b| &b.kind == b"trex") {
        let mut at = Cursor::new(trex.payload, "box trex");
        at.skip(4)?;
        if at.u32()? == id {
            at.skip(4)?;
            return Ok([at.u32()?, at.u32()?]);
        }
    }
    Ok([0, 0])
}

/// Adds the samples of one movie fragment.
fn fragment(
    moof: &Mp4Box,
    id: u32,
    defaults: [u32; 2],
    samples: &mut Vec<TableSample>,
) -> Result<(), MediaError> {
    for traf in boxes(moof.payload, 0)?.into_iter().filter(|b| &b.kind == b"traf") {
        let mut at = Cursor::new(needed(traf.payload, &[b"tfhd"], "box tfhd")?, "box tfhd");
        let flags = at.u32()? & 0xff_ffff;
        if at.u32()? != id {
            continue;
        }
        let base = if flags & 1 != 0 { at.u64()? } else { moof.start as u64 };
        at.skip(if flags & 2 != 0 { 4 } else { 0 })?;
        let duration = if flags & 8 != 0 { at.u32()? } else { defaults[0] };
        let size = if flags & 16 != 0 { at.u32()? } else { defaults[1] };
        let mut decode = match child(traf.payload, b"tfdt")? {
            Some(tfdt) => {
                let mut at = Cursor::new(tfdt, "box tfdt");
                let version = at.u8()?;
                at.skip(3)?;
                if version == 1 { at.i64()? } else { i64::from(at.u32()?) }
            }
            None => samples.last().map_or(0, |s| s.composition.saturating_add(i64::from(s.duration))),
        };
        let mut offset = base;
        for trun in boxes(traf.payload, 0)?.into_iter().filter(|b| &b.kind == b"trun") {
            run(
                trun.payload,
                [base, u64::from(duration), u64::from(size)],
                &mut offset,
                &mut decode,
                samples,
            )?;
        }
    }
    Ok(())
}

/// Adds the samples of one `trun`; `defaults` are the base offset, duration and size.
fn run(
    trun: &[u8],
    defaults: [u64; 3],
    offset: &mut u64,
    decode: &mut i64,
    samples: &mut Vec<TableSample>,
) -> Result<(), MediaError> {
    let mut at = Cursor::new(trun, "box trun");
    let flags = at.u32()? & 0xff_ffff;
    let count = at.u32()? as usize;
    if flags & 1 != 0 {
        *offset = defaults[0].saturating_add_signed(i64::from(at.i32()?));
    }
    at.skip(if flags & 4 != 0 { 4 } else { 0 })?;
    if samples.len().saturating_add(count) > MAX_VIDEO_FRAMES {
        return Err(MediaError::TooManyFrames { given: samples.len().saturating_add(count) });
    }
    for _ in 0..count {
        let duration = if flags & 0x100 != 0 { at.u32()? } else { defaults[1] as u32 };
        let size = if flags & 0x200 != 0 { at.u32()? } else { defaults[2] as u32 };
        at.skip(if flags & 0x400 != 0 { 4 } else { 0 })?;
        let shift = if flags & 0x800 != 0 { i64::from(at.i32()?) } else { 0 };
        samples.push(TableSample {
            offset: *offset,
            size,
            composition: decode.saturating_add(shift),
            duration,
        });
        *offset = offset.saturating_add(u64::from(size));
        *decode = decode.saturating_add(i64::from(duration));
    }
    Ok(())
}

/// An edit: its duration (movie's time scale; 0: to the end) and its media time (track's time scale; -1: empty).
struct Edit {
    duration: u64,
    media_time: i64,
}

fn edit_list(bytes: &[u8]) -> Result<Vec<Edit>, MediaError> {
    let mut at = Cursor::new(bytes, "box elst");
    let version = at.u8()?;
    at.skip(3)?;
    let count = (at.u32()? as usize).min(at.rest().len() / 12);
    let mut edits = vec![];
    for _ in 0..count {
        let (duration, media_time) = match version {
            1 => (at.u64()?, at.i64()?),
            _ => (u64::from(at.u32()?), i64::from(at.i32()?)),
        };
        at.skip(4)?;
        edits.push(Edit { duration, media_time });
    }
    Ok(edits)
}

/// When a sample is shown (s): in the first edit that holds it. An edit's end is rounded to the movie's time scale, so that a
/// sample that begins within half its duration after it still belongs to it.
fn presented(sample: &TableSample, edits: &[Edit], scale: f64, movie_scale: f64) -> Option<f64> {
    let mut start = 0.0;
    if edits.iter().all(|e| e.media_time < 0) {
        let delay: f64 = edits.iter().map(|e| e.duration as f64 / movie_scale).sum();
        return Some(delay + sample.composition as f64 / scale);
    }
    for edit in edits {
        let length = edit.duration as f64 / movie_scale;
        if edit.media_time >= 0 {
            let since = (sample.composition as f64 - edit.media_time as f64) / scale;
            let slack = 0.5 * f64::from(sample.duration) / scale;
            if since >= 0.0 && (edit.duration == 0 || since < length + slack) {
                return Some(start + since);
            }
        }
        start += length;
    }
    None
}
