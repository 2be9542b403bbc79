//! Bytes to text: UTF-8, UTF-16 or Latin-1, with any line ends. Files that are no text are refused with what to do instead.

use crate::scene::violations::SceneError;

/// The text of a file, and its encoding if that is not UTF-8.
#[derive(Debug)]
pub(super) struct DecodedText {
    pub text: String,
    pub encoding: Option<&'static str>,
}

/// How files that are no text begin, what they are, and how to write their content as text.
const BINARY: [(&[u8], &str, &str); 11] = [
    (
        b"\x89HDF",
        "an HDF5 file",
        "write CSV: in DeepLabCut `analyze_videos(..., save_as_csv=True)`, in SLEAP `sleap-convert --format analysis.csv`, in pandas `pandas.read_hdf(FILE).to_csv(\"tracks.csv\")`",
    ),
    (b"PAR1", "a Parquet file", "write CSV: `pandas.read_parquet(FILE).to_csv(\"tracks.csv\", index=False)`"),
    (
        b"\x93NUMPY",
        "a NumPy array of this kind",
        "write CSV: `numpy.savetxt(\"tracks.csv\", array, delimiter=\",\", header=\"id,frame,x,y\", comments=\"\")`",
    ),
    (
        b"PK\x03\x04",
        "an archive without a workbook, arrays or a Tracker project",
        "unpack it, and give the file with the tracks",
    ),
    (b"\xd0\xcf\x11\xe0", "an Excel file of before 2007", "save it as .xlsx or CSV"),
    (b"\x1f\x8b", "compressed with gzip", "unpack it first: gunzip FILE"),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd", "unpack it first: zstd -d FILE"),
    (b"\x80\x04", "a Python pickle", "write CSV: `pandas.read_pickle(FILE).to_csv(\"tracks.csv\")`"),
    (b"MATLAB 5.0", "a MATLAB file", "write CSV: writematrix or writetable"),
    (b"\x89MCAP", "a trace", "give the scene that it is of; `vrdp trace` and `vrdp replay` read traces"),
    (
        b"ARROW1",
        "an Arrow file",
        "write CSV: `pandas.read_feather(FILE).to_csv(\"tracks.csv\", index=False)`",
    ),
];
/// Bytes at the start that show the encoding.
const SAMPLE: usize = 4096;
/// The characters of Windows-1252 from 0x80 to 0x9f, where Latin-1 has control characters; a space: none.
const WINDOWS: [char; 32] = [
    '€', ' ', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', ' ', 'Ž', ' ', ' ', '‘', '’', '“', '”',
    '•', '–', '—', '˜', '™', 'š', '›', 'œ', ' ', 'ž', 'Ÿ',
];

/// The text of a file, without a byte order mark and with `\n` at the line ends.
pub(super) fn decode(bytes: &[u8]) -> Result<DecodedText, SceneError> {
    if let Some((_, what, cure)) = BINARY.iter().find(|(start, ..)| bytes.starts_with(start)) {
        return Err(SceneError::single("(file)", format!("is {what}, not text; {cure}")));
    }
    let (text, encoding) = match bytes {
        [0xff, 0xfe, rest @ ..] => (utf16(rest, u16::from_le_bytes), Some("UTF-16")),
        [0xfe, 0xff, rest @ ..] => (utf16(rest, u16::from_be_bytes), Some("UTF-16")),
        _ => match zeros(bytes) {
            [_, odd] if odd > 0.4 => (utf16(bytes, u16::from_le_bytes), Some("UTF-16")),
            [even, _] if even > 0.4 => (utf16(bytes, u16::from_be_bytes), Some("UTF-16")),
            [even, odd] if even + odd > 0.0 => {
                let message = "is no text; give a CSV file, or text as a spreadsheet or tracker writes it";
                return Err(SceneError::single("(file)", message));
            }
            _ => match std::str::from_utf8(bytes) {
                Ok(text) => (text.to_string(), None),
                Err(_) => (bytes.iter().map(|byte| latin(*byte)).collect(), Some("Latin-1")),
            },
        },
    };
    let text = text.trim_start_matches('\u{feff}').trim_end_matches('\0');
    let text = if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text.into() };
    Ok(DecodedText { text, encoding })
}

/// Share of the bytes at even and at odd places of the start that are zero: text in UTF-16 has many at one of both.
fn zeros(bytes: &[u8]) -> [f64; 2] {
    let sample = bytes.get(..SAMPLE).unwrap_or(bytes);
    [0, 1].map(|offset| {
        let zero = sample.iter().skip(offset).step_by(2).filter(|byte| **byte == 0).count();
        2.0 * zero as f64 / sample.len().max(2) as f64
    })
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes.chunks_exact(2).filter_map(|pair| pair.try_into().ok()).map(unit);
    char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

fn latin(byte: u8) -> char {
    match byte {
        0x80..=0x9f => WINDOWS.get(usize::from(byte - 0x80)).copied().unwrap_or(' '),
        _ => char::from(byte),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_of_one_text_give_that_text() {
        let text = "id;t;x;y\n1;0;0,5;µ\n";
        let units: Vec<u16> = text.encode_utf16().collect();
        let le: Vec<u8> = units.iter().flat_map(|u| u.to_le_bytes()).collect();
        let be: Vec<u8> = units.iter().flat_map(|u| u.to_be_bytes()).collect();
        let latin: Vec<u8> = text.chars().map(|c| c as u8).collect();
        let marked = |mark: &[u8], bytes: &[u8]| [mark, bytes].concat();
        for (bytes, encoding) in [
            (text.as_bytes().to_vec(), None),
            (marked(b"\xef\xbb\xbf", text.as_bytes()), None),
            (text.replace('\n', "\r\n").into_bytes(), None),
            (text.replace('\n', "\r").into_bytes(), None),
            (marked(b"\xff\xfe", &le), Some("UTF-16")),
            (marked(b"\xfe\xff", &be), Some("UTF-16")),
            (le, Some("UTF-16")),
            (be, Some("UTF-16")),
            (latin, Some("Latin-1")),
        ] {
            let decoded = decode(&bytes).unwrap();
            assert_eq!((decoded.text.as_str(), decoded.encoding), (text, encoding));
        }
    }

    #[test]
    fn what_is_no_text_is_refused_with_the_way_to_text() {
        for (bytes, cure) in [
            (&b"\x89HDF\r\n\x1a\n"[..], "save_as_csv=True"),
            (b"PAR1\x15\x04", "read_parquet(FILE).to_csv"),
            (b"PK\x03\x04\x14\x00", "unpack it"),
            (b"\x00\x01\x02\x03abcdefgh", "is no text"),
        ] {
            let message = decode(bytes).unwrap_err().to_string();
            assert!(message.starts_with("(file): is ") && message.contains(cure), "{message}");
        }
    }
}
