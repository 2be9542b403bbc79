//! A video's bytes to its frames with their times. Bytes in, data out: no files, no clock.
//!
//! | file | job |
//! |---|---|
//! | `video` | `Video` and `VideoFrame`: the container is read first, frames are pulled one by one in the order of display |
//! | `mp4`, `matroska`, `avi` | containers to coded frames (`packets`) with the container's own times |
//! | `h264` | parameter sets and decoding; the decoder itself is a crate in pure Rust |
//! | `colour` | planes to RGB: range, matrix, chroma position; rotation |
//! | `pictures` | PNG, JPEG and GIF |
//! | `stills` | a few frames as small JPEG files |
//! | `limits`, `error`, `bytes` | what is allowed; why a video is refused, and the cure; checked reading |

mod avi;
mod bytes;
mod colour;
mod error;
mod h264;
mod limits;
mod matroska;
mod mp4;
mod packets;
mod pictures;
mod stills;
#[cfg(test)]
mod tests;
mod video;

pub use error::MediaError;
pub use limits::{
    MAX_FRAME_PIXELS, MAX_REORDER, MAX_STILL_BYTES, MAX_STILLS, MAX_VIDEO_BYTES, MAX_VIDEO_FRAMES,
};
pub use packets::QuarterTurns;
pub use stills::{Still, StillError, still_frames};
pub use video::{Video, VideoFrame, VideoInfo, is_video};
