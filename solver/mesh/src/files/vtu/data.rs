//! Encodings of a VTK data array.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use std::io::{Read as _, Write as _};

/// Size of a block before compression in bytes, VTK's own default.
const BLOCK: usize = 32_768;

/// Compresses bytes into zlib blocks, preceded by a header of 64-bit numbers (number of blocks,
/// block size, size of the last block, compressed sizes); both are encoded in base64.
pub fn compress(bytes: &[u8]) -> String {
    let mut sizes = Vec::new();
    let mut packed = Vec::new();
    for block in bytes.chunks(BLOCK) {
        let before = packed.len();
        let mut encoder = flate2::write::ZlibEncoder::new(&mut packed, flate2::Compression::fast());
        // Writing to memory cannot fail.
        let _ = encoder.write_all(block);
        let _ = encoder.finish();
        sizes.push((packed.len() - before) as u64);
    }
    let partial = bytes.len() % BLOCK;
    let header = [sizes.len() as u64, BLOCK as u64, partial as u64];
    let header: Vec<u8> = header
        .iter()
        .chain(&sizes)
        .flat_map(|n| n.to_le_bytes())
        .collect();
    format!("{}{}", STANDARD.encode(header), STANDARD.encode(packed))
}

/// Encoding of the binary arrays in a file.
#[derive(Debug, Clone, Copy)]
pub struct Encoding {
    pub big_endian: bool,
    /// Size of the numbers in headers, 4 or 8 bytes.
    pub header_size: usize,
    pub compressed: bool,
}

impl Encoding {
    fn integer(self, bytes: &[u8]) -> Option<usize> {
        let mut wide = [0; 8];
        let bytes = bytes.get(..self.header_size)?;
        if self.big_endian {
            wide[8 - self.header_size..].copy_from_slice(bytes);
            usize::try_from(u64::from_be_bytes(wide)).ok()
        } else {
            wide[..self.header_size].copy_from_slice(bytes);
            usize::try_from(u64::from_le_bytes(wide)).ok()
        }
    }

    /// Decodes the array at the beginning of base64 text; text after the array is ignored. An array
    /// of more than `max` bytes is not decoded.
    pub fn base64(self, text: &str, max: usize) -> Result<Vec<u8>, Undecoded> {
        let text: Vec<u8> = text
            .bytes()
            .filter(|byte| !byte.is_ascii_whitespace())
            .collect();
        let decode = |from: usize, n_bytes: usize| {
            let end = from.checked_add(n_bytes.div_ceil(3).checked_mul(4)?)?;
            let mut bytes = STANDARD.decode(text.get(from..end)?).ok()?;
            bytes.truncate(n_bytes);
            (bytes.len() == n_bytes).then_some((bytes, end))
        };
        let whole = |from: usize, n_bytes: usize| decode(from, n_bytes).ok_or(Undecoded::Damaged);
        let (head, _) = whole(0, self.header_size)?;
        let first = self.integer(&head).ok_or(Undecoded::Damaged)?;
        if !self.compressed {
            let length = self.header_size.checked_add(first);
            let (bytes, _) = whole(0, length.ok_or(Undecoded::Damaged)?)?;
            return bounded(bytes[self.header_size..].to_vec(), max);
        }
        let (header, end) = whole(0, self.length_of_header(first)?)?;
        let total = self
            .packed_sizes(&header)
            .and_then(|sizes| {
                sizes
                    .iter()
                    .try_fold(0usize, |sum, size| sum.checked_add(*size))
            })
            .ok_or(Undecoded::Damaged)?;
        let (packed, _) = whole(end, total)?;
        self.unpack(&header, &packed, max)
    }

    /// Decodes the array at the beginning of raw bytes. An array of more than `max` bytes is not
    /// decoded.
    pub fn raw(self, bytes: &[u8], max: usize) -> Result<Vec<u8>, Undecoded> {
        let first = self.integer(bytes).ok_or(Undecoded::Damaged)?;
        if !self.compressed {
            let end = self.header_size.checked_add(first);
            let found = end.and_then(|end| bytes.get(self.header_size..end));
            return bounded(found.ok_or(Undecoded::Damaged)?.to_vec(), max);
        }
        let n_header = self.length_of_header(first)?;
        let header = bytes.get(..n_header).ok_or(Undecoded::Damaged)?;
        self.unpack(header, &bytes[n_header..], max)
    }

    /// Length of the header of so many blocks.
    fn length_of_header(self, n_blocks: usize) -> Result<usize, Undecoded> {
        let n = n_blocks.checked_add(3);
        n.and_then(|n| self.header_size.checked_mul(n))
            .ok_or(Undecoded::Damaged)
    }

    fn packed_sizes(self, header: &[u8]) -> Option<Vec<usize>> {
        header
            .chunks_exact(self.header_size)
            .skip(3)
            .map(|n| self.integer(n))
            .collect()
    }

    fn unpack(self, header: &[u8], packed: &[u8], max: usize) -> Result<Vec<u8>, Undecoded> {
        let mut bytes = Vec::new();
        let mut at = 0usize;
        for size in self.packed_sizes(header).ok_or(Undecoded::Damaged)? {
            let end = at.checked_add(size).ok_or(Undecoded::Damaged)?;
            let block = packed.get(at..end).ok_or(Undecoded::Damaged)?;
            // One byte more than is allowed tells an excess, whatever the headers say.
            let left = (max - bytes.len()) as u64;
            flate2::read::ZlibDecoder::new(block)
                .take(left + 1)
                .read_to_end(&mut bytes)
                .map_err(|_| Undecoded::Damaged)?;
            if bytes.len() > max {
                return Err(Undecoded::TooLong);
            }
            at = end;
        }
        Ok(bytes)
    }
}

/// Reason why an array is not decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Undecoded {
    /// Its bytes are not those of an array.
    Damaged,
    /// It has more bytes than its numbers need.
    TooLong,
}

fn bounded(bytes: Vec<u8>, max: usize) -> Result<Vec<u8>, Undecoded> {
    match bytes.len() <= max {
        true => Ok(bytes),
        false => Err(Undecoded::TooLong),
    }
}

/// Size of a number of a VTK type in bytes; `None` for types other than numbers.
pub fn size_of(kind: &str) -> Option<usize> {
    match kind {
        "Float64" | "Int64" | "UInt64" => Some(8),
        "Float32" | "Int32" | "UInt32" => Some(4),
        "Int16" | "UInt16" => Some(2),
        "Int8" | "UInt8" => Some(1),
        _ => None,
    }
}

/// Decodes bytes as numbers of a VTK type; `None` for types other than numbers or a length that
/// does not fit.
pub fn numbers(kind: &str, bytes: &[u8], big_endian: bool) -> Option<Vec<f64>> {
    macro_rules! decode {
        ($type:ty) => {{
            const SIZE: usize = std::mem::size_of::<$type>();
            if !bytes.len().is_multiple_of(SIZE) {
                return None;
            }
            let number = |chunk: &[u8]| {
                let mut wide = [0; SIZE];
                wide.copy_from_slice(chunk);
                (if big_endian {
                    <$type>::from_be_bytes(wide)
                } else {
                    <$type>::from_le_bytes(wide)
                }) as f64
            };
            Some(bytes.chunks_exact(SIZE).map(number).collect())
        }};
    }
    match kind {
        "Float64" => decode!(f64),
        "Float32" => decode!(f32),
        "Int64" => decode!(i64),
        "UInt64" => decode!(u64),
        "Int32" => decode!(i32),
        "UInt32" => decode!(u32),
        "Int16" => decode!(i16),
        "UInt16" => decode!(u16),
        "Int8" => decode!(i8),
        "UInt8" => decode!(u8),
        _ => None,
    }
}
