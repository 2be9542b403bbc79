//! What a video may hold. Each limit bounds memory or time before anything is allocated.

/// Largest video file (bytes): it is held in memory while its frames are decoded.
pub const MAX_VIDEO_BYTES: usize = 256 << 20;
/// Most frames of one video: ten minutes at 25 frames/s, as many as a scene may have.
pub const MAX_VIDEO_FRAMES: usize = 15_000;
/// Most pixels of one frame: DCI 4K. A decoder holds up to 17 such frames.
pub const MAX_FRAME_PIXELS: usize = 4096 * 2304;
/// Most frames that wait for an earlier one: the largest decoded picture buffer of H.264 (Annex A.3.1).
pub const MAX_REORDER: usize = 16;
/// Smallest width and height (px): below, nothing can be located.
pub const MIN_FRAME_SIDE: usize = 8;
/// Most stills of one video.
pub const MAX_STILLS: usize = 12;
/// Largest file of a still (bytes): three times what a frame of a camera with little noise takes.
pub const MAX_STILL_BYTES: usize = 64 << 10;
/// Longest side of a still (px): a body of CLEVRER's videos is 30 px wide there.
pub const MAX_STILL_SIDE: usize = 480;
/// Most boxes, chunks or elements read of one container: more than any valid file with `MAX_VIDEO_FRAMES` needs.
pub(super) const MAX_ELEMENTS: usize = 1 << 20;
