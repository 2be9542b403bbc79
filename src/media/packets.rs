//! What a container holds: the coded frames of its video track in decoding order.

/// Codec of a track.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Codec {
    /// H.264 in samples of NAL units, each after its length in this many bytes, with the parameter sets of the container.
    H264 { length_bytes: usize, parameter_sets: Vec<Vec<u8>> },
    /// One JPEG picture per frame.
    Jpeg,
}

/// One coded frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Packet {
    /// Bytes of the file.
    pub offset: usize,
    pub size: usize,
    /// When the frame is shown (s); `None`: it is decoded but not shown (an edit list cuts it).
    pub time: Option<f64>,
    /// Key of the order of display; unique up to damaged files.
    pub order: i64,
}

/// Clockwise rotation that a player applies to the decoded frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum QuarterTurns {
    #[default]
    None,
    Quarter,
    Half,
    ThreeQuarters,
}

/// A video track.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VideoTrack {
    pub codec: Codec,
    pub packets: Vec<Packet>,
    pub turns: QuarterTurns,
    /// Width over height of a pixel, where the container gives it.
    pub pixel_aspect: Option<f64>,
}
