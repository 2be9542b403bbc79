//! AVI with Motion JPEG: RIFF chunks to the coded frames of the first video stream.
//!
//! A RIFF file is a tree of chunks (code, little-endian size, payload, padding to an even size); `LIST` and `RIFF` chunks hold
//! others. `hdrl/strl` has a header per stream (`strh`: kind, codec, scale and rate: a frame lasts scale/rate seconds) and its
//! format (`strf`). `movi` holds the frames as chunks `NNdc` or `NNdb`, NN the stream's number. An empty chunk repeats the last
//! frame. Source: Microsoft, AVI RIFF File Reference.

use super::bytes::{Cursor, code};
use super::error::MediaError;
use super::limits::{MAX_ELEMENTS, MAX_VIDEO_FRAMES};
use super::packets::{Codec, Packet, QuarterTurns, VideoTrack};

/// Deepest nesting of lists: RIFF, movi, rec.
const MAX_DEPTH: usize = 4;

#[derive(Default)]
struct Streams {
    /// Number, codec and duration of a frame (s) of the video stream.
    video: Option<(usize, [u8; 4], f64)>,
    count: usize,
    packets: Vec<Packet>,
    chunks: usize,
}

/// Reads an AVI file.
pub(super) fn read(bytes: &[u8]) -> Result<VideoTrack, MediaError> {
    let mut streams = Streams::default();
    walk(bytes, 0..bytes.len(), 0, &mut streams)?;
    let Some((_, codec, _)) = streams.video else { return Err(MediaError::NoVideo) };
    if !matches!(&codec.map(|b| b.to_ascii_uppercase()), b"MJPG" | b"JPEG" | b"AVRN" | b"LJPG") {
        return Err(MediaError::Codec { codec: format!("{} (in AVI)", code(codec)) });
    }
    if streams.packets.is_empty() {
        return Err(MediaError::Missing { part: "frames (list movi)" });
    }
    Ok(VideoTrack {
        codec: Codec::Jpeg,
        packets: streams.packets,
        turns: QuarterTurns::None,
        pixel_aspect: None,
    })
}

fn walk(
    bytes: &[u8],
    range: std::ops::Range<usize>,
    depth: usize,
    streams: &mut Streams,
) -> Result<(), MediaError> {
    let mut at = range.start;
    while at + 8 <= range.end {
        let mut header = Cursor::new(&bytes[at..range.end], "a chunk header");
        let (kind, size) = (header.four()?, header.u32_le()? as usize);
        let start = at + 8;
        let end = start.saturating_add(size);
        streams.chunks += 1;
        if streams.chunks > MAX_ELEMENTS {
            return Err(MediaError::damaged("the file", "has too many chunks"));
        }
        let is_list = matches!(&kind, b"RIFF" | b"LIST");
        if is_list && depth < MAX_DEPTH && start + 4 <= range.end {
            walk(bytes, start + 4..end.min(range.end), depth + 1, streams)?;
        } else if end > range.end {
            return Err(MediaError::truncated(format!("chunk {}", code(kind))));
        } else {
            chunk(kind, &bytes[start..end], start, streams)?;
        }
        at = end.saturating_add(size % 2);
    }
    Ok(())
}

fn chunk(kind: [u8; 4], payload: &[u8], start: usize, streams: &mut Streams) -> Result<(), MediaError> {
    match &kind {
        b"strh" => {
            let mut at = Cursor::new(payload, "chunk strh");
            let (stream, codec) = (at.four()?, at.four()?);
            at.skip(12)?;
            let (scale, rate) = (at.u32_le()?, at.u32_le()?);
            if &stream == b"vids" && streams.video.is_none() {
                if scale == 0 || rate == 0 {
                    return Err(MediaError::damaged("chunk strh", "has no frame rate"));
                }
                streams.video = Some((streams.count, codec, f64::from(scale) / f64::from(rate)));
            }
            streams.count += 1;
        }
        // The codec of the format is the one that counts.
        b"strf" => {
            if let (Some((number, codec, _)), Some(format)) = (&mut streams.video, payload.get(16..20))
                && *number + 1 == streams.count
            {
                codec.copy_from_slice(format);
            }
        }
        [a, b, b'd', b'b' | b'c'] if a.is_ascii_digit() && b.is_ascii_digit() => {
            let number = usize::from(a - b'0') * 10 + usize::from(b - b'0');
            let Some((video, _, frame_time)) = streams.video else { return Ok(()) };
            if number != video {
                return Ok(());
            }
            let index = streams.packets.len();
            if index >= MAX_VIDEO_FRAMES {
                return Err(MediaError::TooManyFrames { given: index + 1 });
            }
            let (offset, size) = match (payload.len(), streams.packets.last()) {
                (0, Some(last)) => (last.offset, last.size),
                (size, _) => (start, size),
            };
            let time = Some(index as f64 * frame_time);
            streams.packets.push(Packet { offset, size, time, order: index as i64 });
        }
        _ => {}
    }
    Ok(())
}
