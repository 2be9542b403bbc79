//! A video: what it is, and its frames one by one in the order of display.
//!
//! Packets are decoded in their own order. A frame is given out as soon as no packet that is still to come is shown before it, so
//! that as few frames wait as the coding asks for.

use super::colour::{to_rgb, turned};
use super::error::{MediaError, check_size};
use super::h264::H264;
use super::limits::{MAX_REORDER, MAX_VIDEO_BYTES, MAX_VIDEO_FRAMES};
use super::packets::{Codec, QuarterTurns, VideoTrack};
use super::{avi, matroska, mp4, pictures};
use crate::num::median;

/// A video in memory.
#[derive(Debug)]
pub struct Video {
    bytes: Vec<u8>,
    source: Source,
    info: VideoInfo,
}

#[derive(Debug)]
enum Source {
    Track(VideoTrack),
    Gif,
    /// Encoded pictures, one after another in `bytes`, each with its range.
    Pictures(Vec<std::ops::Range<usize>>),
}

/// What a video is, known before its frames are decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoInfo {
    /// Such as "H.264 in MP4".
    pub format: String,
    /// Width and height of a frame as it is shown (px).
    pub size: [usize; 2],
    /// When each frame is shown (s), strictly increasing.
    pub times: Vec<f64>,
    /// Nominal frame rate (1/s): the inverse of the median interval; `None` for a single frame.
    pub fps: Option<f64>,
    /// Width over height of a pixel, 1 if square.
    pub pixel_aspect: f64,
    pub turns: QuarterTurns,
}

/// One frame.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoFrame {
    pub index: usize,
    /// s.
    pub time: f64,
    /// Width and height (px).
    pub size: [usize; 2],
    /// Red, green and blue (sRGB or BT.709 transfer) of each pixel, row by row.
    pub rgb: Vec<u8>,
}

/// Whether the first bytes of a file are those of a video or a picture.
pub fn is_video(head: &[u8]) -> bool {
    let at = |range: std::ops::Range<usize>| head.get(range).unwrap_or(&[]);
    let riff = at(0..4) == b"RIFF" && at(8..12) == b"AVI ";
    let matroska = at(0..4) == [0x1A, 0x45, 0xDF, 0xA3];
    let picture =
        at(0..4) == b"GIF8" || at(0..4) == [0x89, b'P', b'N', b'G'] || at(0..3) == [0xFF, 0xD8, 0xFF];
    is_mp4(at(4..8)) || riff || matroska || picture
}

/// Whether these four bytes are the name of a box that an MP4 or MOV begins with.
fn is_mp4(name: &[u8]) -> bool {
    matches!(name, b"ftyp" | b"moov" | b"mdat" | b"wide" | b"free" | b"skip")
}

impl Video {
    /// Reads the container; frames are decoded by [`Video::frames`].
    pub fn open(bytes: Vec<u8>) -> Result<Video, MediaError> {
        if bytes.is_empty() {
            return Err(MediaError::Empty);
        }
        if bytes.len() > MAX_VIDEO_BYTES {
            return Err(MediaError::TooLarge { given: bytes.len() });
        }
        let head = |range: std::ops::Range<usize>| bytes.get(range).unwrap_or(&[]);
        if is_mp4(head(4..8)) {
            let track = mp4::read(&bytes)?;
            return Video::of_track(bytes, track, "MP4");
        }
        match (head(0..4), head(8..12)) {
            ([0x1A, 0x45, 0xDF, 0xA3], _) => {
                let track = matroska::read(&bytes)?;
                Video::of_track(bytes, track, "Matroska")
            }
            (b"RIFF", b"AVI ") => {
                let track = avi::read(&bytes)?;
                Video::of_track(bytes, track, "AVI")
            }
            (b"GIF8", _) => Video::of_gif(bytes),
            ([0x89, b'P', b'N', b'G'] | [0xFF, 0xD8, 0xFF, _], _) => Video::of_pictures(vec![bytes], &[0.0]),
            (start, _) => {
                let start = start.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(" ");
                Err(MediaError::UnknownContainer { start })
            }
        }
    }

    /// The first frame of a video, or a picture.
    pub fn first_frame(bytes: Vec<u8>) -> Result<VideoFrame, MediaError> {
        Video::open(bytes)?.frames().next().unwrap_or(Err(MediaError::Empty))
    }

    /// A video of PNG or JPEG files, each with its time (s). The shorter of the two lists counts.
    pub fn of_pictures(files: Vec<Vec<u8>>, times: &[f64]) -> Result<Video, MediaError> {
        let total = files.iter().map(Vec::len).fold(0usize, usize::saturating_add);
        if total > MAX_VIDEO_BYTES {
            return Err(MediaError::TooLarge { given: total });
        }
        let first = files.first().ok_or(MediaError::Empty)?;
        let (_, size) = pictures::picture(first, 0)?;
        let mut ranges = vec![];
        let mut bytes = Vec::with_capacity(total);
        for file in &files {
            ranges.push(bytes.len()..bytes.len() + file.len());
            bytes.extend_from_slice(file);
        }
        let times = times.iter().copied().take(ranges.len()).collect();
        let info = information("pictures".into(), size, times)?;
        Ok(Video { bytes, source: Source::Pictures(ranges), info })
    }

    fn of_gif(bytes: Vec<u8>) -> Result<Video, MediaError> {
        let (mut times, mut size) = (vec![], [0, 0]);
        for frame in pictures::gif(&bytes)? {
            let ((_, shown), time) = frame?;
            (size, _) = (shown, times.push(time));
        }
        let info = information("GIF".into(), size, times)?;
        Ok(Video { bytes, source: Source::Gif, info })
    }

    fn of_track(bytes: Vec<u8>, track: VideoTrack, container: &str) -> Result<Video, MediaError> {
        if track.packets.len() > MAX_VIDEO_FRAMES {
            return Err(MediaError::TooManyFrames { given: track.packets.len() });
        }
        for (frame, packet) in track.packets.iter().enumerate() {
            if packet.offset.saturating_add(packet.size) > bytes.len() {
                return Err(MediaError::truncated(format!("frame {frame} of {}", track.packets.len())));
            }
        }
        let mut shown: Vec<(i64, f64)> =
            track.packets.iter().filter_map(|p| Some((p.order, p.time?))).collect();
        shown.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let times: Vec<f64> = shown.into_iter().map(|s| s.1).collect();
        let mut decoding = Decoding::new(&track.codec)?;
        let (size, coded_aspect) = match &decoding {
            Decoding::H264(h264) if h264.parameters().is_some() => {
                h264.parameters().map(|p| (p.size, p.pixel_aspect)).unwrap_or_default()
            }
            _ => {
                let first = track.packets.first().ok_or(MediaError::Missing { part: "frames" })?;
                (decoding.decode(&bytes[first.offset..][..first.size], 0)?.1, None)
            }
        };
        let size = match track.turns {
            QuarterTurns::Quarter | QuarterTurns::ThreeQuarters => [size[1], size[0]],
            _ => size,
        };
        let codec = if track.codec == Codec::Jpeg { "Motion JPEG" } else { "H.264" };
        let mut info = information(format!("{codec} in {container}"), size, times)?;
        info.pixel_aspect = track.pixel_aspect.or(coded_aspect).unwrap_or(1.0);
        info.turns = track.turns;
        Ok(Video { bytes, source: Source::Track(track), info })
    }

    pub fn info(&self) -> &VideoInfo {
        &self.info
    }

    /// All frames, from the first, in the order of display.
    pub fn frames(&self) -> Box<dyn Iterator<Item = Result<VideoFrame, MediaError>> + '_> {
        let size = self.info.size;
        let pulled: Box<dyn Iterator<Item = Result<VideoFrame, MediaError>>> = match &self.source {
            Source::Track(track) => match TrackFrames::new(self, track) {
                Ok(frames) => Box::new(frames),
                Err(error) => Box::new(std::iter::once(Err(error))),
            },
            Source::Gif => match pictures::gif(&self.bytes) {
                Err(error) => Box::new(std::iter::once(Err(error))),
                Ok(frames) => Box::new(frames.enumerate().map(|(index, frame)| {
                    frame.map(|((rgb, size), time)| VideoFrame { index, time, size, rgb })
                })),
            },
            Source::Pictures(ranges) => {
                Box::new(ranges.iter().zip(&self.info.times).enumerate().map(|(index, (range, &time))| {
                    let (rgb, size) = pictures::picture(&self.bytes[range.clone()], index)?;
                    Ok(VideoFrame { index, time, size, rgb })
                }))
            }
        };
        // The first error ends the video; so does a frame of another size.
        let mut failed = false;
        Box::new(pulled.map_while(move |frame| {
            if failed {
                return None;
            }
            let checked = frame.and_then(|f| {
                let change = MediaError::SizeChange { frame: f.index, from: size, to: f.size };
                if f.size == size { Ok(f) } else { Err(change) }
            });
            failed = checked.is_err();
            Some(checked)
        }))
    }
}

/// Checks the times and gives what else is known.
fn information(format: String, size: [usize; 2], times: Vec<f64>) -> Result<VideoInfo, MediaError> {
    check_size(size[0], size[1])?;
    if times.is_empty() {
        return Err(MediaError::Missing { part: "frames that are shown" });
    }
    if let Some(k) = times.windows(2).position(|w| w[0].partial_cmp(&w[1]) != Some(std::cmp::Ordering::Less))
    {
        let what = format!("has frames {k} and {} both at {} s", k + 1, times[k]);
        return Err(MediaError::damaged("the list of frame times", what));
    }
    let mut steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let fps = median(&mut steps).map(|step| 1.0 / step);
    Ok(VideoInfo { format, size, times, fps, pixel_aspect: 1.0, turns: QuarterTurns::None })
}

/// The decoder of a track.
enum Decoding {
    H264(Box<H264>),
    Jpeg,
}

impl Decoding {
    fn new(codec: &Codec) -> Result<Decoding, MediaError> {
        match codec {
            Codec::Jpeg => Ok(Decoding::Jpeg),
            Codec::H264 { length_bytes, parameter_sets } => {
                Ok(Decoding::H264(Box::new(H264::new(*length_bytes, parameter_sets)?)))
            }
        }
    }

    fn decode(&mut self, packet: &[u8], frame: usize) -> Result<pictures::Rgb, MediaError> {
        match self {
            Decoding::Jpeg => pictures::picture(packet, frame),
            Decoding::H264(h264) => {
                let picture = h264.decode(packet, frame)?;
                Ok((to_rgb(&picture.planes(), picture.coding), picture.size))
            }
        }
    }
}

/// The frames of a track: decoded, then ordered.
struct TrackFrames<'a> {
    video: &'a Video,
    track: &'a VideoTrack,
    decoding: Decoding,
    /// Next packet to decode.
    packet: usize,
    /// Least order of the shown packets from each one on.
    least_order: Vec<i64>,
    /// Decoded frames that wait: order, time, pixels.
    waiting: Vec<(i64, f64, pictures::Rgb)>,
    given: usize,
}

impl<'a> TrackFrames<'a> {
    fn new(video: &'a Video, track: &'a VideoTrack) -> Result<Self, MediaError> {
        let mut least_order = vec![i64::MAX; track.packets.len() + 1];
        for (k, packet) in track.packets.iter().enumerate().rev() {
            let own = if packet.time.is_some() { packet.order } else { i64::MAX };
            least_order[k] = least_order[k + 1].min(own);
        }
        let decoding = Decoding::new(&track.codec)?;
        Ok(TrackFrames { video, track, decoding, packet: 0, least_order, waiting: vec![], given: 0 })
    }

    /// The waiting frame that is next, if no later packet is shown before it.
    fn ready(&mut self) -> Option<VideoFrame> {
        let next = (0..self.waiting.len()).min_by_key(|&k| self.waiting[k].0)?;
        if self.waiting[next].0 > self.least_order[self.packet] {
            return None;
        }
        let (_, time, (rgb, size)) = self.waiting.swap_remove(next);
        let (rgb, size) = turned(rgb, size, self.track.turns);
        let frame = VideoFrame { index: self.given, time, size, rgb };
        self.given += 1;
        Some(frame)
    }

    fn decode(&mut self) -> Result<(), MediaError> {
        let packet = self.track.packets[self.packet];
        let bytes = &self.video.bytes[packet.offset..][..packet.size];
        let decoded = self.decoding.decode(bytes, self.packet)?;
        if let Some(time) = packet.time {
            self.waiting.push((packet.order, time, decoded));
        }
        self.packet += 1;
        if self.waiting.len() > MAX_REORDER + 1 {
            return Err(MediaError::Reorder { frame: self.given });
        }
        Ok(())
    }
}

impl Iterator for TrackFrames<'_> {
    type Item = Result<VideoFrame, MediaError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(frame) = self.ready() {
                return Some(Ok(frame));
            }
            if self.packet >= self.track.packets.len() {
                return None;
            }
            if let Err(error) = self.decode() {
                return Some(Err(error));
            }
        }
    }
}
