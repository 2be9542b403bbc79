//! Why a video cannot be read. Each message names the box, frame or codec, and what to do.

use super::limits::{MAX_FRAME_PIXELS, MAX_REORDER, MAX_VIDEO_BYTES, MAX_VIDEO_FRAMES, MIN_FRAME_SIDE};

/// The command that turns any video into one that is read.
const CONVERT: &str =
    "convert it: ffmpeg -i IN -vf yadif=deint=interlaced -c:v libx264 -pix_fmt yuv420p OUT.mp4";

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MediaError {
    #[error("is empty; give a video file")]
    Empty,
    #[error("has {given} bytes, more than {MAX_VIDEO_BYTES}; cut or compress the video")]
    TooLarge { given: usize },
    #[error(
        "is of no known kind (it begins with {start}); give MP4, MOV, MKV, WebM, AVI with MJPEG, GIF, PNG or JPEG"
    )]
    UnknownContainer { start: String },
    #[error("ends within {part}: the file is truncated; copy or download it again")]
    Truncated { part: String },
    #[error("has no {part}; the file is damaged or not complete: record or copy it again")]
    Missing { part: &'static str },
    #[error("{part} {what}; the file is damaged: copy it again, or {CONVERT}")]
    Damaged { part: String, what: String },
    #[error("has no video track; give a file with moving pictures")]
    NoVideo,
    #[error("has the codec {codec}, which is not decoded here; {CONVERT}")]
    Codec { codec: String },
    #[error("is encrypted ({scheme}); give the video without copy protection")]
    Encrypted { scheme: String },
    #[error("uses {what}, which is not decoded here; {CONVERT}")]
    Feature { what: String },
    #[error("frame {frame}: {what}; the file is damaged: copy it again, or {CONVERT}")]
    Frame { frame: usize, what: String },
    #[error("has frames of {width} x {height} px, more than {MAX_FRAME_PIXELS} pixels; scale the video down")]
    TooManyPixels { width: usize, height: usize },
    #[error("has frames of {width} x {height} px; give at least {MIN_FRAME_SIDE} px each way")]
    TooSmall { width: usize, height: usize },
    #[error("has {given} frames, more than {MAX_VIDEO_FRAMES}; cut the video")]
    TooManyFrames { given: usize },
    #[error("frame {frame} waits for more than {MAX_REORDER} later frames; {CONVERT}")]
    Reorder { frame: usize },
    #[error("changes its size at frame {frame}, from {from:?} to {to:?} px; cut the video there")]
    SizeChange { frame: usize, from: [usize; 2], to: [usize; 2] },
}

impl MediaError {
    pub(super) fn damaged(part: impl Into<String>, what: impl Into<String>) -> MediaError {
        MediaError::Damaged { part: part.into(), what: what.into() }
    }

    pub(super) fn truncated(part: impl Into<String>) -> MediaError {
        MediaError::Truncated { part: part.into() }
    }
}

/// Checks the size of a frame (px).
pub(super) fn check_size(width: usize, height: usize) -> Result<(), MediaError> {
    if width.saturating_mul(height) > MAX_FRAME_PIXELS {
        return Err(MediaError::TooManyPixels { width, height });
    }
    if width < MIN_FRAME_SIDE || height < MIN_FRAME_SIDE {
        return Err(MediaError::TooSmall { width, height });
    }
    Ok(())
}
