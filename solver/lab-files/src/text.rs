//! Decoding of text files: UTF-8, UTF-16 and the encoding of western Windows.

use std::borrow::Cow;

use encoding_rs::{UTF_16BE, UTF_16LE, WINDOWS_1252};

/// Number of bytes that are examined for the zeros of UTF-16 without a byte-order mark.
const PROBE: usize = 512;

/// Text with the name of its encoding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Decoded<'a> {
    /// Text as UTF-8, without a byte-order mark.
    pub text: Cow<'a, str>,
    /// Name of the encoding.
    pub encoding: &'static str,
}

/// Decodes a text. `None` for a binary file. Line ends of old Macs, a carriage return alone, become
/// line feeds.
#[must_use]
pub fn decode(bytes: &[u8]) -> Option<Decoded<'_>> {
    let mut decoded = in_its_encoding(bytes)?;
    if decoded.text.contains('\r') && !decoded.text.contains('\n') {
        decoded.text = Cow::Owned(decoded.text.replace('\r', "\n"));
    }
    Some(decoded)
}

fn in_its_encoding(bytes: &[u8]) -> Option<Decoded<'_>> {
    if let Some(rest) = bytes.strip_prefix(b"\xff\xfe") {
        return utf_16(rest, UTF_16LE, "UTF-16 (little endian)");
    }
    if let Some(rest) = bytes.strip_prefix(b"\xfe\xff") {
        return utf_16(rest, UTF_16BE, "UTF-16 (big endian)");
    }
    let probe = &bytes[..bytes.len().min(PROBE)];
    if probe.contains(&0) {
        // Latin text in UTF-16 has a zero in every other byte.
        let zeros = |offset: usize| {
            let pairs = probe.len() / 2;
            let n = probe
                .chunks_exact(2)
                .filter(|pair| pair[offset] == 0 && pair[1 - offset] != 0)
                .count();
            n > 0 && 10 * n >= 9 * pairs
        };
        return if zeros(1) {
            utf_16(bytes, UTF_16LE, "UTF-16 (little endian, without a mark)")
        } else if zeros(0) {
            utf_16(bytes, UTF_16BE, "UTF-16 (big endian, without a mark)")
        } else {
            None
        };
    }
    let (bytes, name) = match bytes.strip_prefix(b"\xef\xbb\xbf") {
        Some(rest) => (rest, "UTF-8 (with a mark)"),
        None => (bytes, "UTF-8"),
    };
    if let Ok(text) = std::str::from_utf8(bytes) {
        return Some(Decoded {
            text: Cow::Borrowed(text),
            encoding: name,
        });
    }
    if bytes.contains(&0) {
        return None;
    }
    Some(Decoded {
        text: WINDOWS_1252.decode_without_bom_handling(bytes).0,
        encoding: "Windows-1252",
    })
}

fn utf_16<'a>(
    bytes: &'a [u8],
    from: &'static encoding_rs::Encoding,
    encoding: &'static str,
) -> Option<Decoded<'a>> {
    let text = from.decode_without_bom_handling(bytes).0;
    Some(Decoded { text, encoding })
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "Zeit [s]\tDruck (µV) é\n0,1\t7,5\n";

    fn utf_16(text: &str, big: bool) -> Vec<u8> {
        text.encode_utf16()
            .flat_map(|u| {
                if big {
                    u.to_be_bytes()
                } else {
                    u.to_le_bytes()
                }
            })
            .collect()
    }

    #[test]
    fn line_ends_of_old_macs_are_line_ends() {
        assert_eq!(decode(b"t,p\r0,7\r").unwrap().text, "t,p\n0,7\n");
        assert_eq!(decode(b"t,p\r\n0,7\r\n").unwrap().text, "t,p\r\n0,7\r\n");
    }

    #[test]
    fn every_encoding_gives_the_same_text() {
        let (windows, _, lossy) = WINDOWS_1252.encode(TEXT);
        assert!(!lossy);
        let cases: [(Vec<u8>, &str); 7] = [
            (TEXT.into(), "UTF-8"),
            (
                [b"\xef\xbb\xbf", TEXT.as_bytes()].concat(),
                "UTF-8 (with a mark)",
            ),
            (
                [&b"\xff\xfe"[..], &utf_16(TEXT, false)].concat(),
                "UTF-16 (little endian)",
            ),
            (
                [&b"\xfe\xff"[..], &utf_16(TEXT, true)].concat(),
                "UTF-16 (big endian)",
            ),
            (
                utf_16(TEXT, false),
                "UTF-16 (little endian, without a mark)",
            ),
            (utf_16(TEXT, true), "UTF-16 (big endian, without a mark)"),
            (windows.into_owned(), "Windows-1252"),
        ];
        for (bytes, encoding) in cases {
            let decoded = decode(&bytes).unwrap();
            assert_eq!((decoded.text.as_ref(), decoded.encoding), (TEXT, encoding));
        }
    }

    #[test]
    fn a_binary_file_is_no_text() {
        assert_eq!(decode(b"\x00\x01\x02\x03\x00\x00\x00\x09"), None);
        assert_eq!(decode(&[vec![b'a'; 600], vec![0, 0xff]].concat()), None);
        assert_eq!(decode(b"").unwrap().text, "");
    }
}
