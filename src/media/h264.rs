//! H.264: parameter sets, and packets to pictures.
//!
//! The decoder is a pure Rust crate. It does not read the video usability information (VUI) of the sequence parameter set, which
//! says range and colour matrix, so that the set is parsed here too, with the checks that bound memory: size, depth, chroma
//! format and field coding. Source: ITU-T H.264 (2021), sections 7.3.2.1.1, 7.4.2.1.1 and E.1.1.

use super::colour::{ColourCoding, ColourMatrix, Planes};
use super::error::{MediaError, check_size};
use rusty_h264_decoder::{DecodeError, Decoder};

/// Width from which BT.709 is taken where the video names no matrix: high definition (BT.709's own range of use).
const HD_HEIGHT: usize = 720;
/// Profiles whose sequence parameter set has chroma format and bit depth.
const HIGH_PROFILES: [u64; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];

/// What a sequence parameter set says of the pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SequenceParameters {
    pub size: [usize; 2],
    pub coding: ColourCoding,
    /// Width over height of a pixel.
    pub pixel_aspect: Option<f64>,
}

/// Bits of a payload, highest first; beyond its end they are missing.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Bits<'_> {
    fn bit(&mut self) -> Option<u64> {
        let byte = *self.bytes.get(self.at / 8)?;
        self.at += 1;
        Some(u64::from(byte >> (7 - (self.at - 1) % 8) & 1))
    }

    fn bits(&mut self, count: usize) -> Option<u64> {
        (0..count).try_fold(0, |sum, _| Some(sum << 1 | self.bit()?))
    }

    /// Exponential Golomb code.
    fn unsigned(&mut self) -> Option<u64> {
        let mut zeros = 0;
        while self.bit()? == 0 {
            zeros += 1;
            if zeros > 32 {
                return None;
            }
        }
        Some((1 << zeros) - 1 + self.bits(zeros)?)
    }

    /// Skips a scaling list; its deltas are signed Golomb codes.
    fn scaling_list(&mut self, entries: usize) -> Option<()> {
        let (mut last, mut next) = (8i64, 8i64);
        for _ in 0..entries {
            if next != 0 {
                let code = self.unsigned()? as i64;
                let delta = if code % 2 == 1 { (code + 1) / 2 } else { -code / 2 };
                next = (last + delta).rem_euclid(256);
            }
            last = if next == 0 { last } else { next };
        }
        Some(())
    }
}

/// The payload of a NAL unit without its emulation prevention bytes.
fn payload(nal: &[u8]) -> Vec<u8> {
    let (mut out, mut zeros) = (Vec::with_capacity(nal.len()), 0);
    for &byte in nal.iter().skip(1) {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        out.push(byte);
    }
    out
}

/// Reads a sequence parameter set and checks what is decoded here.
pub(super) fn sequence_parameters(nal: &[u8]) -> Result<SequenceParameters, MediaError> {
    let bytes = payload(nal);
    let mut bits = Bits { bytes: &bytes, at: 0 };
    let short = || MediaError::damaged("the sequence parameter set", "is cut");
    let head = parse_head(&mut bits).ok_or_else(short)?;
    let refused = |what: &str| Err(MediaError::Feature { what: what.into() });
    if head.bit_depth > 8 {
        return refused(&format!("{} bits per sample", head.bit_depth));
    }
    if head.chroma_format != 1 {
        return refused("chroma that is not 4:2:0");
    }
    if head.is_interlaced {
        return refused("interlaced frames");
    }
    let [width, height] = head.size.ok_or_else(|| {
        MediaError::damaged("the sequence parameter set", "crops more than the frame or is too large")
    })?;
    check_size(width, height)?;
    // A cut VUI is ignored, as players do.
    let (pixel_aspect, full_range, matrix) = usability(&mut bits).unwrap_or_default();
    let matrix = match matrix {
        Some(1) => ColourMatrix::Bt709,
        Some(4..=7) => ColourMatrix::Bt601,
        _ if height >= HD_HEIGHT => ColourMatrix::Bt709,
        _ => ColourMatrix::Bt601,
    };
    Ok(SequenceParameters {
        size: [width, height],
        coding: ColourCoding { matrix, full_range },
        pixel_aspect,
    })
}

struct Head {
    chroma_format: u64,
    bit_depth: u64,
    is_interlaced: bool,
    /// Width and height after cropping (px); `None` where they make no sense.
    size: Option<[usize; 2]>,
}

/// All of a sequence parameter set before its VUI.
fn parse_head(bits: &mut Bits) -> Option<Head> {
    let profile = bits.bits(8)?;
    bits.bits(16)?;
    bits.unsigned()?;
    let mut head = Head { chroma_format: 1, bit_depth: 8, is_interlaced: false, size: None };
    if HIGH_PROFILES.contains(&profile) {
        head.chroma_format = bits.unsigned()?;
        if head.chroma_format == 3 {
            bits.bit()?;
        }
        head.bit_depth = 8 + bits.unsigned()?.max(bits.unsigned()?);
        bits.bit()?;
        if bits.bit()? == 1 {
            for list in 0..if head.chroma_format == 3 { 12 } else { 8 } {
                if bits.bit()? == 1 {
                    bits.scaling_list(if list < 6 { 16 } else { 64 })?;
                }
            }
        }
    }
    bits.unsigned()?;
    match bits.unsigned()? {
        0 => {
            bits.unsigned()?;
        }
        1 => {
            bits.bit()?;
            bits.unsigned()?;
            bits.unsigned()?;
            for _ in 0..bits.unsigned()?.min(255) {
                bits.unsigned()?;
            }
        }
        _ => {}
    }
    bits.unsigned()?;
    bits.bit()?;
    let (across, down) = (bits.unsigned()? + 1, bits.unsigned()? + 1);
    let only_frames = bits.bit()?;
    // Frames may be progressive although fields are allowed; macroblock-adaptive coding is interlaced always.
    head.is_interlaced = only_frames == 0 && bits.bit()? == 1;
    bits.bit()?;
    let mut crop = [0; 4];
    if bits.bit()? == 1 {
        for c in &mut crop {
            *c = bits.unsigned()?;
        }
    }
    let (unit_x, unit_y) = (2, 2 * (2 - only_frames));
    let width = across.saturating_mul(16).checked_sub(crop[0].saturating_add(crop[1]).saturating_mul(unit_x));
    let height = down
        .saturating_mul(16 * (2 - only_frames))
        .checked_sub(crop[2].saturating_add(crop[3]).saturating_mul(unit_y));
    head.size =
        width.zip(height).filter(|s| s.0 < 1 << 20 && s.1 < 1 << 20).map(|(w, h)| [w as usize, h as usize]);
    Some(head)
}

/// Pixel aspect, full range and number of the colour matrix of the VUI.
fn usability(bits: &mut Bits) -> Option<(Option<f64>, bool, Option<u64>)> {
    /// Width and height of a pixel by `aspect_ratio_idc` (table E-1).
    const ASPECTS: [(u32, u32); 17] = [
        (0, 1),
        (1, 1),
        (12, 11),
        (10, 11),
        (16, 11),
        (40, 33),
        (24, 11),
        (20, 11),
        (32, 11),
        (80, 33),
        (18, 11),
        (15, 11),
        (64, 33),
        (160, 99),
        (4, 3),
        (3, 2),
        (2, 1),
    ];
    if bits.bit()? == 0 {
        return None;
    }
    let mut aspect = None;
    if bits.bit()? == 1 {
        let index = bits.bits(8)? as usize;
        let (w, h) = match index {
            255 => (bits.bits(16)? as u32, bits.bits(16)? as u32),
            _ => ASPECTS.get(index).copied().unwrap_or((0, 1)),
        };
        aspect = (w > 0 && h > 0).then(|| f64::from(w) / f64::from(h));
    }
    if bits.bit()? == 1 {
        bits.bit()?;
    }
    let (mut full, mut matrix) = (false, None);
    if bits.bit()? == 1 {
        bits.bits(3)?;
        full = bits.bit()? == 1;
        if bits.bit()? == 1 {
            bits.bits(16)?;
            matrix = Some(bits.bits(8)?);
        }
    }
    Some((aspect, full, matrix))
}

/// A decoder of packets.
pub(super) struct H264 {
    decoder: Decoder,
    length_bytes: usize,
    parameters: Option<SequenceParameters>,
    /// Bytes of one access unit with start codes.
    access_unit: Vec<u8>,
}

/// A decoded picture.
pub(super) struct DecodedPicture {
    pub size: [usize; 2],
    pub y: Vec<u8>,
    pub u: Vec<u8>,
    pub v: Vec<u8>,
    pub coding: ColourCoding,
}

impl DecodedPicture {
    pub fn planes(&self) -> Planes<'_> {
        Planes { width: self.size[0], height: self.size[1], y: &self.y, u: &self.u, v: &self.v }
    }
}

impl H264 {
    pub fn new(length_bytes: usize, parameter_sets: &[Vec<u8>]) -> Result<H264, MediaError> {
        let mut h264 = H264 { decoder: Decoder::new(), length_bytes, parameters: None, access_unit: vec![] };
        for nal in parameter_sets {
            h264.add(nal)?;
        }
        let unit = std::mem::take(&mut h264.access_unit);
        h264.decoder.decode(&unit).map_err(|e| refusal(e, 0))?;
        Ok(h264)
    }

    pub fn parameters(&self) -> Option<SequenceParameters> {
        self.parameters
    }

    /// Adds a NAL unit to the access unit; sequence parameter sets are checked first.
    fn add(&mut self, nal: &[u8]) -> Result<(), MediaError> {
        /// NAL unit type of a sequence parameter set.
        const SEQUENCE_PARAMETER_SET: u8 = 7;
        let Some(&head) = nal.first() else { return Ok(()) };
        if head & 0x1f == SEQUENCE_PARAMETER_SET {
            self.parameters = Some(sequence_parameters(nal)?);
        }
        self.access_unit.extend_from_slice(&[0, 0, 0, 1]);
        self.access_unit.extend_from_slice(nal);
        Ok(())
    }

    /// Decodes the packet of frame `frame`.
    pub fn decode(&mut self, packet: &[u8], frame: usize) -> Result<DecodedPicture, MediaError> {
        let broken = |what: &str| MediaError::Frame { frame, what: what.into() };
        self.access_unit.clear();
        let mut rest = packet;
        while !rest.is_empty() {
            let (length, after) = rest
                .split_at_checked(self.length_bytes)
                .ok_or_else(|| broken("a NAL unit's length is cut"))?;
            let size = length.iter().fold(0usize, |sum, &b| sum << 8 | usize::from(b));
            let (nal, after) =
                after.split_at_checked(size).ok_or_else(|| broken("a NAL unit is longer than its packet"))?;
            self.add(nal)?;
            rest = after;
        }
        let unit = std::mem::take(&mut self.access_unit);
        let decoded = self.decoder.decode(&unit);
        self.access_unit = unit;
        let picture = decoded.map_err(|e| refusal(e, frame))?.ok_or_else(|| broken("holds no picture"))?;
        let parameters = self.parameters.ok_or(MediaError::Missing { part: "sequence parameter set" })?;
        let size = [picture.width, picture.height];
        let chroma = size[0].div_ceil(2) * size[1].div_ceil(2);
        if size != parameters.size
            || picture.y.len() < size[0] * size[1]
            || picture.u.len().min(picture.v.len()) < chroma
        {
            return Err(broken("has another size than its parameter set"));
        }
        Ok(DecodedPicture { size, y: picture.y, u: picture.u, v: picture.v, coding: parameters.coding })
    }
}

fn refusal(error: DecodeError, frame: usize) -> MediaError {
    match error {
        DecodeError::Unsupported(what) => MediaError::Feature { what: what.into() },
        DecodeError::Truncated => MediaError::Frame { frame, what: "ends early".into() },
        DecodeError::MissingParameterSet => MediaError::Frame { frame, what: "has no parameter set".into() },
        DecodeError::Internal(what) => MediaError::Frame { frame, what: what.into() },
    }
}
