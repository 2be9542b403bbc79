//! Single pictures (PNG, JPEG) and GIF.

use super::error::{MediaError, check_size};
use super::limits::{MAX_FRAME_PIXELS, MAX_VIDEO_FRAMES};
use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, ImageDecoder, ImageReader, Limits};
use std::io::Cursor;

/// Shortest delay of a GIF's frame (s); players show shorter ones, which mean "as fast as possible", at 0.1 s.
const MIN_GIF_DELAY: f64 = 0.015;
const DEFAULT_GIF_DELAY: f64 = 0.1;

/// RGB pixels with width and height.
pub(super) type Rgb = (Vec<u8>, [usize; 2]);

fn limits() -> Limits {
    let mut limits = Limits::default();
    // 16 bits and alpha need 8 bytes a pixel; decoders hold a second copy.
    limits.max_alloc = Some(16 * MAX_FRAME_PIXELS as u64);
    limits
}

fn refusal(frame: usize) -> impl Fn(image::ImageError) -> MediaError {
    move |error| match error {
        image::ImageError::Limits(_) => MediaError::TooManyPixels { width: 0, height: 0 },
        error => MediaError::Frame { frame, what: error.to_string() },
    }
}

/// Decodes the PNG or JPEG of frame `frame`.
pub(super) fn picture(bytes: &[u8], frame: usize) -> Result<Rgb, MediaError> {
    let broken = |e: std::io::Error| MediaError::Frame { frame, what: e.to_string() };
    let reader = || ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(broken);
    let (width, height) = reader()?.into_dimensions().map_err(refusal(frame))?;
    check_size(width as usize, height as usize)?;
    let mut reader = reader()?;
    reader.limits(limits());
    let picture = reader.decode().map_err(refusal(frame))?.into_rgb8();
    let size = [picture.width() as usize, picture.height() as usize];
    Ok((picture.into_raw(), size))
}

/// The frames of a GIF with the time of each (s).
pub(super) fn gif(
    bytes: &[u8],
) -> Result<impl Iterator<Item = Result<(Rgb, f64), MediaError>> + '_, MediaError> {
    let mut decoder = GifDecoder::new(Cursor::new(bytes)).map_err(refusal(0))?;
    let (width, height) = decoder.dimensions();
    check_size(width as usize, height as usize)?;
    decoder.set_limits(limits()).map_err(refusal(0))?;
    let mut time = 0.0;
    let frames = decoder.into_frames().take(MAX_VIDEO_FRAMES + 1).enumerate();
    Ok(frames.map(move |(index, frame)| {
        if index >= MAX_VIDEO_FRAMES {
            return Err(MediaError::TooManyFrames { given: index + 1 });
        }
        let frame = frame.map_err(refusal(index))?;
        let (numerator, denominator) = frame.delay().numer_denom_ms();
        let delay = f64::from(numerator) / f64::from(denominator.max(1)) / 1000.0;
        let shown = time;
        time += if delay < MIN_GIF_DELAY { DEFAULT_GIF_DELAY } else { delay };
        let rgba = frame.into_buffer();
        let size = [rgba.width() as usize, rgba.height() as usize];
        let rgb = rgba.pixels().flat_map(|p| [p[0], p[1], p[2]]).collect();
        Ok(((rgb, size), shown))
    }))
}
