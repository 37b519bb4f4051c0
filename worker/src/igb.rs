//! openCARP's `.igb` files: a header of 1,024 bytes with `key:value` pairs, then the values of all
//! nodes, one frame after the other.
//!
//! Format: openCARP's manual, "Output File Formats". Values are `raw * facteur + zero`. The header
//! gives the time of the first frame (`org_t`) and the time span of all frames (`dim_t` or
//! `inc_t`).

use std::collections::BTreeMap;

/// Length of the header in bytes.
const HEADER: usize = 1024;

/// Header of a file of single-precision millivolts (little-endian) with one frame per millisecond
/// from 0 on. The values of each frame's nodes follow it in the file.
///
/// - `n_nodes`, `n_frames`: size of the data after the header
/// - `length_ms`: time of the last frame
#[must_use]
pub fn header_mv(n_nodes: usize, n_frames: usize, length_ms: f64) -> Vec<u8> {
    let text = format!(
        "x:{n_nodes} y:1 z:1 t:{n_frames} type:float systeme:little_endian \r\n\
         org_t:0 dim_t:{length_ms} fac_t:1 unites_x:um unites_y:um unites_z:um unites_t:ms unites:mV facteur:1 zero:0 \r\n"
    );
    let mut bytes = text.into_bytes();
    bytes.resize(HEADER - 1, b' ');
    bytes.push(0x0c);
    bytes
}

/// Values of all nodes at several times.
#[derive(Debug, Clone, PartialEq)]
pub struct Igb {
    /// Times of the frames \[ms\].
    pub time_ms: Vec<f64>,
    /// Number of nodes, each with one value in every frame.
    pub n_nodes: usize,
    /// Value `k` of node `i` at `k · n_nodes + i`.
    pub values: Vec<f64>,
}

/// Reasons why bytes are not a readable `.igb` file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IgbError {
    /// The file is shorter than its header.
    #[error("found {0} bytes, expected a header of 1,024 bytes and data")]
    Short(usize),
    /// A key of the header is missing or not a number.
    #[error("the header lacks a number for `{0}`")]
    Key(&'static str),
    /// The type of the values is not supported.
    #[error("found type `{0}`, expected float or double")]
    Type(String),
    /// The byte order is unknown.
    #[error("found systeme `{0}`, expected little_endian or big_endian")]
    Order(String),
    /// The size of the data differs from the size in the header.
    #[error(
        "found {found} bytes of data, expected {expected}: {n_nodes} nodes at {n_frames} times"
    )]
    Length {
        /// Number of bytes after the header.
        found: usize,
        /// Number of bytes according to the header.
        expected: usize,
        /// Number of nodes according to the header.
        n_nodes: usize,
        /// Number of frames according to the header.
        n_frames: usize,
    },
}

/// Reads a file.
///
/// # Errors
/// [`IgbError`] for a header or data that cannot be read.
pub fn read(bytes: &[u8]) -> Result<Igb, IgbError> {
    if bytes.len() < HEADER {
        return Err(IgbError::Short(bytes.len()));
    }
    let (header, data) = bytes.split_at(HEADER);
    let header = String::from_utf8_lossy(header).into_owned();
    let pairs: BTreeMap<&str, &str> = (header.split_ascii_whitespace())
        .filter(|word| !word.starts_with('#'))
        .filter_map(|word| word.split_once(':'))
        .collect();
    let number = |key: &'static str| {
        pairs
            .get(key)
            .and_then(|text| text.parse::<f64>().ok())
            .filter(|x| x.is_finite())
    };
    let count = |key| {
        number(key)
            .filter(|n| *n >= 1.0 && n.fract() == 0.0)
            .map(|n| n as usize)
    };
    let n_nodes =
        count("x").ok_or(IgbError::Key("x"))? * count("y").unwrap_or(1) * count("z").unwrap_or(1);
    let n_frames = count("t").ok_or(IgbError::Key("t"))?;
    let kind = pairs.get("type").copied().unwrap_or("float");
    let size = match kind {
        "float" => 4,
        "double" => 8,
        other => return Err(IgbError::Type(other.to_owned())),
    };
    let is_big = match pairs.get("systeme").copied().unwrap_or("little_endian") {
        "little_endian" => false,
        "big_endian" => true,
        other => return Err(IgbError::Order(other.to_owned())),
    };
    let expected = n_nodes.saturating_mul(n_frames).saturating_mul(size);
    // According to the manual, data end with a form feed; openCARP's own files end without it.
    let data = if data.len() == expected + 1 {
        data.strip_suffix(b"\x0c").unwrap_or(data)
    } else {
        data
    };
    if data.len() != expected {
        return Err(IgbError::Length {
            found: data.len(),
            expected,
            n_nodes,
            n_frames,
        });
    }
    let (factor, zero) = (
        number("facteur").unwrap_or(1.0),
        number("zero").unwrap_or(0.0),
    );
    let value = |raw: &[u8]| {
        let mut raw = raw.to_vec();
        if is_big {
            raw.reverse();
        }
        let raw = match size {
            4 => f64::from(f32::from_le_bytes(raw.try_into().unwrap_or_default())),
            _ => f64::from_le_bytes(raw.try_into().unwrap_or_default()),
        };
        raw * factor + zero
    };
    let first = number("org_t").unwrap_or(0.0);
    let span = number("dim_t")
        .filter(|_| n_frames > 1)
        .map(|span| span / (n_frames - 1) as f64);
    let step = number("inc_t").or(span).ok_or(IgbError::Key("dim_t"))?;
    Ok(Igb {
        time_ms: (0..n_frames).map(|k| first + k as f64 * step).collect(),
        n_nodes,
        values: data.chunks_exact(size).map(value).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = header.as_bytes().to_vec();
        bytes.resize(HEADER, b' ');
        bytes.extend_from_slice(data);
        bytes
    }

    // Header of the `vm.igb` that openCARP's first tutorial writes, with fewer nodes.
    const HEAD: &str = "x:2 y:1 z:1 t:3 type:float systeme:little_endian org_x:0 org_y:0 org_z:0 org_t:0 dim_x:1 dim_y:0 dim_z:0 \
                        dim_t:20 unites_x:um unites_y:um unites_z:um unites_t:ms unites:mV facteur:1 zero:0 \r\n";

    #[test]
    fn floats_of_either_order_are_read_with_their_times() {
        let numbers = [0.0_f32, 1.0, 2.0, 3.0, 4.5, -85.0];
        let little: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let big: Vec<u8> = numbers.iter().flat_map(|x| x.to_be_bytes()).collect();
        let found = read(&file(HEAD, &little)).unwrap();
        assert_eq!(
            (found.n_nodes, &found.time_ms[..]),
            (2, &[0.0, 10.0, 20.0][..])
        );
        assert_eq!(found.values, numbers.map(f64::from));
        assert_eq!(
            read(&file(&HEAD.replace("little", "big"), &big)).unwrap(),
            found
        );
        let ended = [&little[..], b"\x0c"].concat();
        assert_eq!(read(&file(HEAD, &ended)).unwrap(), found);
        let scaled = read(&file(
            &HEAD.replace("facteur:1 zero:0", "facteur:2 zero:1"),
            &little,
        ))
        .unwrap();
        assert_eq!(scaled.values[5], -169.0);
    }

    #[test]
    fn what_we_write_is_read_again() {
        let mut bytes = header_mv(2, 3, 2.0);
        let numbers = [-85.0_f32, f32::NAN, 0.0, 1.0, 2.0, 20.5];
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        let found = read(&bytes).unwrap();
        assert_eq!(
            (found.n_nodes, &found.time_ms[..]),
            (2, &[0.0, 1.0, 2.0][..])
        );
        assert!(found.values[1].is_nan());
        assert_eq!((found.values[0], found.values[5]), (-85.0, 20.5));
    }

    #[test]
    fn what_does_not_fit_its_header_is_refused() {
        assert_eq!(read(b"x:2"), Err(IgbError::Short(3)));
        let short = read(&file(HEAD, &[0; 20]));
        assert_eq!(
            short,
            Err(IgbError::Length {
                found: 20,
                expected: 24,
                n_nodes: 2,
                n_frames: 3
            })
        );
        assert_eq!(
            read(&file(&HEAD.replace("type:float", "type:byte"), &[0; 24])),
            Err(IgbError::Type("byte".into()))
        );
        assert_eq!(
            read(&file(&HEAD.replace("x:2 ", ""), &[0; 24])),
            Err(IgbError::Key("x"))
        );
    }
}
