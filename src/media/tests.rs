//! Containers and the decoder, on small videos that ffmpeg and x264 made of a rendered one; hostile bytes.

use super::h264::{H264, sequence_parameters};
use super::packets::{Codec, QuarterTurns};
use super::{MediaError, Video, mp4};
use proptest::prelude::*;

macro_rules! video_file {
    ($name:literal) => {
        include_bytes!(concat!("../../tests/data/media/", $name)).as_slice()
    };
}

const B_FRAMES: &[u8] = video_file!("b_frames.mp4");
const VARIABLE_RATE: &[u8] = video_file!("variable_rate.mp4");
const ALL: [&[u8]; 8] = [
    B_FRAMES,
    video_file!("fragmented.mp4"),
    video_file!("full_range_709.mp4"),
    VARIABLE_RATE,
    video_file!("rotated.mp4"),
    video_file!("b_frames.mkv"),
    video_file!("motion.avi"),
    video_file!("small.gif"),
];

/// FNV-1a, 64 bits.
fn hash(bytes: impl Iterator<Item = u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3))
}

/// Hash of the luma planes in the order of display.
fn luma_hash(bytes: &[u8]) -> u64 {
    let track = mp4::read(bytes).unwrap();
    let Codec::H264 { length_bytes, parameter_sets } = &track.codec else { panic!("no H.264") };
    let mut decoder = H264::new(*length_bytes, parameter_sets).unwrap();
    let mut pictures: Vec<(i64, Vec<u8>)> = vec![];
    for (k, p) in track.packets.iter().enumerate() {
        pictures.push((p.order, decoder.decode(&bytes[p.offset..][..p.size], k).unwrap().y));
    }
    pictures.sort_by_key(|p| p.0);
    hash(pictures.into_iter().flat_map(|p| p.1))
}

#[test]
fn decoded_luma_is_bit_exact_with_ffmpeg() {
    // ffmpeg 5.1.6, filter extractplanes=y, hashed in the same way.
    let expected = [
        (B_FRAMES, 0xf0a3_822d_43cd_56fe),
        (video_file!("fragmented.mp4"), 0xe871_cc6f_5b34_29c0),
        (video_file!("full_range_709.mp4"), 0xf0a7_c9f9_e9e5_80d4),
        (VARIABLE_RATE, 0xf1a1_7086_dd89_4e71),
    ];
    for (k, (bytes, hash)) in expected.into_iter().enumerate() {
        assert_eq!(luma_hash(bytes), hash, "{k}");
    }
}

#[test]
fn times_sizes_and_frames_are_those_of_ffprobe() {
    let regular: Vec<f64> = (0..10).map(|k| 0.04 * f64::from(k)).collect();
    let variable = vec![0.0, 0.04, 0.08, 0.16, 0.20, 0.32, 0.36, 0.40, 0.44, 0.48];
    let expected = [
        ("H.264 in MP4", [96, 64], regular.clone()),
        ("H.264 in MP4", [96, 64], regular.clone()),
        ("H.264 in MP4", [98, 62], regular.clone()),
        ("H.264 in MP4", [96, 64], variable),
        ("H.264 in MP4", [64, 96], regular.clone()),
        ("H.264 in Matroska", [96, 64], regular.clone()),
        ("Motion JPEG in AVI", [47, 31], regular[..3].to_vec()),
        ("GIF", [47, 31], regular[..3].to_vec()),
    ];
    for (bytes, (format, size, times)) in ALL.into_iter().zip(expected) {
        let video = Video::open(bytes.to_vec()).unwrap();
        let info = video.info();
        assert_eq!((info.format.as_str(), info.size), (format, size));
        assert_eq!(info.times.len(), times.len(), "{format}");
        assert!(
            info.times.iter().zip(&times).all(|(a, b)| (a - b).abs() < 1e-6),
            "{format} {:?}",
            info.times
        );
        assert!((info.fps.unwrap() - 25.0).abs() < 1e-3);
        let frames: Vec<_> = video.frames().map(Result::unwrap).collect();
        assert_eq!(frames.len(), times.len());
        for (k, frame) in frames.iter().enumerate() {
            assert_eq!((frame.index, frame.time, frame.size), (k, info.times[k], size));
            assert_eq!(frame.rgb.len(), 3 * size[0] * size[1]);
        }
    }
}

#[test]
fn a_rotated_video_is_the_same_video_turned() {
    let frame = |bytes: &[u8]| Video::open(bytes.to_vec()).unwrap().frames().next().unwrap().unwrap();
    let (upright, turned) = (frame(B_FRAMES), frame(video_file!("rotated.mp4")));
    let video = Video::open(video_file!("rotated.mp4").to_vec()).unwrap();
    let at = |f: &super::VideoFrame, u: usize, v: usize| f.rgb[3 * (v * f.size[0] + u)..][..3].to_vec();
    assert_ne!(video.info().turns, QuarterTurns::None);
    let (u, v) = match video.info().turns {
        QuarterTurns::Quarter => (63 - 10, 70),
        _ => (10, 95 - 70),
    };
    assert_eq!(at(&turned, u, v), at(&upright, 70, 10));
}

#[test]
fn the_same_frames_in_another_container_are_equal() {
    // The grey ground of all variants is the same within compression.
    for bytes in ALL {
        let video = Video::open(bytes.to_vec()).unwrap();
        for frame in video.frames() {
            let frame = frame.unwrap();
            let mean = frame.rgb.iter().map(|&b| f64::from(b)).sum::<f64>() / frame.rgb.len() as f64;
            assert!((mean - 127.0).abs() < 6.0, "{} {mean}", video.info().format);
        }
    }
}

#[test]
fn what_is_not_decoded_is_named_with_a_cure() {
    let refused = |bytes: &[u8]| Video::open(bytes.to_vec()).err().map_or(String::new(), |e| e.to_string());
    let cases: [(&[u8], &str); 8] = [
        (video_file!("hevc.mp4"), "HEVC"),
        (video_file!("ten_bit.mp4"), "10 bits"),
        (video_file!("interlaced.mp4"), "interlace"),
        (video_file!("vp9.webm"), "VP9"),
        (&[], "empty"),
        (&B_FRAMES[..1500], "truncated"),
        (b"hello, this is no video", "68 65 6C 6C"),
        (&B_FRAMES[..40], "has no box moov"),
    ];
    for (bytes, word) in cases {
        let message = refused(bytes);
        assert!(message.contains(word), "{word}: {message}");
    }
    for (bytes, _) in &cases[..4] {
        assert!(refused(bytes).contains("ffmpeg"), "{}", refused(bytes));
    }
}

#[test]
fn a_large_picture_in_a_small_file_is_refused_before_it_is_allocated() {
    let track = mp4::read(B_FRAMES).unwrap();
    let Codec::H264 { parameter_sets, .. } = track.codec else { panic!("no H.264") };
    assert_eq!(sequence_parameters(&parameter_sets[0]).unwrap().size, [96, 64]);
    // Profile 66, level 30, then Golomb codes: id 0, frame number 0, order type 2, 1 reference, no gaps, 4096 x 4096 macroblocks.
    let mut bits = String::from("01000010" /* 66 */) + "00000000" + "00011110";
    let golomb = |value: u32| {
        let code = format!("{:b}", value + 1);
        "0".repeat(code.len() - 1) + &code
    };
    bits += &[golomb(0), golomb(0), golomb(2), golomb(1), "0".into(), golomb(4095), golomb(4095)].concat();
    bits += "11001";
    bits += &"0".repeat(8 - bits.len() % 8);
    let mut nal = vec![0x67];
    nal.extend(bits.as_bytes().chunks(8).map(|c| c.iter().fold(0u8, |sum, &b| sum << 1 | (b - b'0'))));
    assert_eq!(sequence_parameters(&nal), Err(MediaError::TooManyPixels { width: 65536, height: 65536 }));
}

/// Opens and decodes everything; errors are fine.
fn consume(bytes: Vec<u8>) {
    if let Ok(video) = Video::open(bytes) {
        let info = video.info().clone();
        for frame in video.frames() {
            let Ok(frame) = frame else { break };
            assert_eq!(frame.rgb.len(), 3 * info.size[0] * info.size[1]);
        }
    }
}

proptest! {
    #[test]
    fn mutated_videos_never_panic(
        which in 0..ALL.len(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        cut in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let mut bytes = ALL[which].to_vec();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if is_cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        consume(bytes);
    }

    #[test]
    fn any_bytes_after_a_known_start_are_read_or_refused(which in 0..4usize, tail in prop::collection::vec(any::<u8>(), 0..200)) {
        let start: [&[u8]; 4] = [b"\0\0\0\x10ftypisom", b"\x1A\x45\xDF\xA3", b"RIFF\0\0\0\0AVI ", b"GIF89a"];
        consume([start[which], &tail].concat());
    }
}
