//! Stills: a few frames of a video as small JPEG files, so that people see later what was seen.

use super::error::{MediaError, check_size};
use super::limits::{MAX_STILL_BYTES, MAX_STILL_SIDE, MAX_STILLS, MIN_FRAME_SIDE};
use super::pictures::picture;
use super::video::VideoFrame;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};
use std::io::Cursor;

/// Qualities of JPEG that are tried in turn: at the first, edges of bodies show no rings; noise may need the others.
const QUALITIES: [u8; 3] = [75, 50, 25];
/// The first bytes of a JPEG file.
const JPEG_START: [u8; 3] = [0xFF, 0xD8, 0xFF];

/// A frame of a video as a picture, scaled down.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Still {
    pub frame: usize,
    /// Width and height of the video's frames (px), not of the picture.
    pub size: [usize; 2],
    #[serde(with = "byte_string")]
    pub jpeg: Vec<u8>,
}

/// Why bytes are no still.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StillError {
    #[error("has {given} bytes, more than {MAX_STILL_BYTES}; scale the picture down, or compress it more")]
    TooLarge { given: usize },
    #[error("is of a video that {0}")]
    VideoSize(MediaError),
    #[error("is no JPEG that can be read ({what}); give a JPEG")]
    NotJpeg { what: String },
    #[error("has {given:?} px, more than {MAX_STILL_SIDE} on a side; scale the picture down")]
    TooWide { given: [usize; 2] },
    #[error("has {given:?} px, which is not the shape of frames of {video:?} px; scale the whole frame")]
    OtherShape { given: [usize; 2], video: [usize; 2] },
}

impl Still {
    /// A still of a frame; `None` if it cannot be made small enough.
    pub fn of(frame: &VideoFrame) -> Option<Still> {
        let size = scaled_size(frame.size);
        if size.iter().any(|side| *side < MIN_FRAME_SIDE) {
            return None;
        }
        let rgb = scaled(frame, size);
        QUALITIES.into_iter().find_map(|quality| {
            let mut jpeg = vec![];
            let [width, height] = size.map(|side| side as u32);
            let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, quality);
            encoder.encode(&rgb, width, height, ExtendedColorType::Rgb8).ok()?;
            let still = Still { frame: frame.index, size: frame.size, jpeg };
            (still.jpeg.len() <= MAX_STILL_BYTES).then_some(still)
        })
    }

    /// Width and height of the picture (px); `None` if it cannot be read.
    pub fn picture_size(&self) -> Option<[usize; 2]> {
        let reader = ImageReader::with_format(Cursor::new(&self.jpeg), ImageFormat::Jpeg);
        let (width, height) = reader.into_dimensions().ok()?;
        Some([width as usize, height as usize])
    }

    /// Checks a picture from outside: it must decode, be small, and have the shape of the video's frames.
    pub fn check(&self) -> Result<(), StillError> {
        if self.jpeg.len() > MAX_STILL_BYTES {
            return Err(StillError::TooLarge { given: self.jpeg.len() });
        }
        let unread = |what: String| StillError::NotJpeg { what };
        if !self.jpeg.starts_with(&JPEG_START) {
            return Err(unread("it does not begin as one".into()));
        }
        check_size(self.size[0], self.size[1]).map_err(StillError::VideoSize)?;
        let (_, given) = picture(&self.jpeg, self.frame).map_err(|e| unread(e.to_string()))?;
        if given.iter().any(|side| *side > MAX_STILL_SIDE) {
            return Err(StillError::TooWide { given });
        }
        // A side is rounded by up to half a pixel.
        let [width, height] = self.size.map(|side| side as f64);
        let [w, h] = given.map(|side| side as f64);
        let is_scaled = (w * height - h * width).abs() <= 0.5 * (width + height);
        is_scaled.then_some(()).ok_or(StillError::OtherShape { given, video: self.size })
    }
}

/// The frames of which stills are taken: the first, the last, and others at even distances in time.
pub fn still_frames(times: &[f64]) -> Vec<usize> {
    let (Some(first), Some(last)) = (times.first(), times.last()) else { return vec![] };
    let steps = MAX_STILLS - 1;
    let nearest = |k: usize| {
        let time = first + (last - first) * k as f64 / steps as f64;
        let after = times.partition_point(|t| *t < time).min(times.len() - 1);
        let before = after.saturating_sub(1);
        if time - times[before] < times[after] - time { before } else { after }
    };
    let mut frames: Vec<usize> = (0..=steps).map(nearest).collect();
    frames.dedup();
    frames
}

/// Size of a still of frames of this size (px).
fn scaled_size(size: [usize; 2]) -> [usize; 2] {
    let longest = size[0].max(size[1]).max(1);
    match longest <= MAX_STILL_SIDE {
        true => size,
        false => size.map(|side| (side * MAX_STILL_SIDE + longest / 2) / longest),
    }
}

/// The pixels of a frame at another size: each is the mean over the area that it covers.
fn scaled(frame: &VideoFrame, size: [usize; 2]) -> Vec<u8> {
    if size == frame.size {
        return frame.rgb.clone();
    }
    let [columns, rows] = [0, 1].map(|axis| covered(frame.size[axis], size[axis]));
    let mut rgb = Vec::with_capacity(3 * size[0] * size[1]);
    for row in &rows {
        for column in &columns {
            let mut sums = [0.0f64; 3];
            for &(v, tall) in row {
                for &(u, wide) in column {
                    let at = 3 * (v * frame.size[0] + u);
                    let pixel = frame.rgb.get(at..at + 3).unwrap_or(&[0; 3]);
                    (0..3).for_each(|c| sums[c] += tall * wide * f64::from(pixel[c]));
                }
            }
            rgb.extend(sums.map(|sum| sum.round().clamp(0.0, 255.0) as u8));
        }
    }
    rgb
}

/// For each of `to` pixels along a side: which of `from` pixels it covers, and the share of each in it.
fn covered(from: usize, to: usize) -> Vec<Vec<(usize, f64)>> {
    let step = from as f64 / to as f64;
    let cover = |k: usize| {
        let (low, high) = (step * k as f64, step * (k + 1) as f64);
        let share = |p: usize| (high.min((p + 1) as f64) - low.max(p as f64)) / step;
        (low as usize..from).take_while(|p| (*p as f64) < high).map(|p| (p, share(p))).collect()
    };
    (0..to).map(cover).collect()
}

/// Bytes as one string of bytes: a list of numbers would take twice as many.
mod byte_string {
    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    pub fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytes)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        deserializer.deserialize_byte_buf(ByteStringVisitor)
    }

    struct ByteStringVisitor;

    impl Visitor<'_> for ByteStringVisitor {
        type Value = Vec<u8>;

        fn expecting(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
            f.write_str("a string of bytes")
        }

        fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Vec<u8>, E> {
            Ok(bytes.to_vec())
        }

        fn visit_byte_buf<E: Error>(self, bytes: Vec<u8>) -> Result<Vec<u8>, E> {
            Ok(bytes)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame whose red grows to the right and whose green grows downwards.
    fn frame(size: [usize; 2]) -> VideoFrame {
        let [width, height] = size;
        let pixel = |k: usize| [(255 * (k % width) / width) as u8, (255 * (k / width) / height) as u8, 80];
        VideoFrame { index: 7, time: 0.3, size, rgb: (0..width * height).flat_map(pixel).collect() }
    }

    #[test]
    fn a_still_is_the_frame_scaled_down() {
        for (size, shown) in [([480, 320], [480, 320]), ([1280, 720], [480, 270]), ([1081, 1923], [270, 480])]
        {
            let still = Still::of(&frame(size)).unwrap();
            assert_eq!((still.frame, still.size), (7, size));
            assert!(still.jpeg.len() < 20_000, "{}", still.jpeg.len());
            assert_eq!(still.check(), Ok(()));
            let (rgb, seen) = picture(&still.jpeg, 0).unwrap();
            assert_eq!((seen, still.picture_size()), (shown, Some(shown)));
            for (u, v) in [(10, 20), (shown[0] / 2, shown[1] / 2), (shown[0] - 9, shown[1] - 9)] {
                let at = 3 * (v * shown[0] + u);
                let expected = [255.0 * u as f64 / shown[0] as f64, 255.0 * v as f64 / shown[1] as f64, 80.0];
                for c in 0..3 {
                    assert!((f64::from(rgb[at + c]) - expected[c]).abs() < 6.0, "{size:?} {u} {v} {c}");
                }
            }
        }
        assert_eq!(Still::of(&frame([4000, 10])), None);
    }

    #[test]
    fn a_noisy_frame_is_compressed_more() {
        let mut noisy = frame([480, 480]);
        let mut state = 1u32;
        for value in &mut noisy.rgb {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *value = 110 + (state >> 28) as u8;
        }
        let still = Still::of(&noisy).unwrap();
        assert!(still.jpeg.len() <= MAX_STILL_BYTES && still.check().is_ok());
    }

    #[test]
    fn shares_of_pixels_sum_to_one() {
        for (from, to) in [(1280, 480), (481, 480), (1923, 480)] {
            let all = covered(from, to);
            assert!(all.iter().all(|c| (c.iter().map(|p| p.1).sum::<f64>() - 1.0).abs() < 1e-9));
            assert_eq!(all.last().and_then(|c| c.last()).map(|p| p.0), Some(from - 1));
        }
    }

    #[test]
    fn frames_are_even_in_time() {
        let even: Vec<f64> = (0..111).map(|f| f as f64 / 25.0).collect();
        assert_eq!(still_frames(&even), (0..12).map(|k| 10 * k).collect::<Vec<_>>());
        // The second half has a tenth of the frames.
        let slower = (0..100).map(|f| 0.01 * f as f64).chain((0..11).map(|f| 1.0 + 0.1 * f as f64));
        let chosen = still_frames(&slower.collect::<Vec<_>>());
        assert_eq!((chosen.len(), chosen[0], chosen[11]), (12, 0, 110));
        assert_eq!(chosen.iter().filter(|f| **f < 100).count(), 6);
        assert_eq!(still_frames(&[0.0, 1.0, 2.0]), [0, 1, 2]);
        assert_eq!(still_frames(&[]), Vec::<usize>::new());
    }

    #[test]
    fn pictures_that_are_no_stills_are_refused() {
        let still = Still::of(&frame([480, 320])).unwrap();
        let checked = |change: &dyn Fn(&mut Still)| {
            let mut other = still.clone();
            change(&mut other);
            other.check().unwrap_err()
        };
        assert!(matches!(checked(&|s| s.jpeg = b"<svg/>".to_vec()), StillError::NotJpeg { .. }));
        assert!(matches!(checked(&|s| s.jpeg.truncate(300)), StillError::NotJpeg { .. }));
        assert!(matches!(checked(&|s| s.jpeg.resize(MAX_STILL_BYTES + 1, 0)), StillError::TooLarge { .. }));
        assert!(matches!(checked(&|s| s.size = [480, 270]), StillError::OtherShape { .. }));
        assert!(matches!(checked(&|s| s.size = [0, 0]), StillError::VideoSize(_)));
        let mut wide = vec![];
        let mut encoder = JpegEncoder::new(&mut wide);
        encoder.encode(&[0; 3 * 960 * 64], 960, 64, ExtendedColorType::Rgb8).unwrap();
        let given = checked(&|s| (s.size, s.jpeg) = ([960, 64], wide.clone()));
        assert_eq!(given, StillError::TooWide { given: [960, 64] });
    }

    #[test]
    fn a_still_is_stored_as_bytes() {
        let still = Still { frame: 3, size: [16, 8], jpeg: vec![0xFF; 1000] };
        let mut stored = vec![];
        ciborium::into_writer(&still, &mut stored).unwrap();
        assert!(stored.len() < 1050, "{}", stored.len());
        assert_eq!(ciborium::from_reader::<Still, _>(stored.as_slice()).unwrap(), still);
    }
}
