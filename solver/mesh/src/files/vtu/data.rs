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

    /// Decodes the array at the beginning of base64 text; text after the array is ignored.
    pub fn base64(self, text: &str) -> Option<Vec<u8>> {
        let text: Vec<u8> = text
            .bytes()
            .filter(|byte| !byte.is_ascii_whitespace())
            .collect();
        let decode = |from: usize, n_bytes: usize| {
            let end = from + n_bytes.div_ceil(3) * 4;
            let mut bytes = STANDARD.decode(text.get(from..end)?).ok()?;
            bytes.truncate(n_bytes);
            (bytes.len() == n_bytes).then_some((bytes, end))
        };
        if !self.compressed {
            let (head, _) = decode(0, self.header_size)?;
            let length = self.integer(&head)?;
            let (bytes, _) = decode(0, self.header_size.checked_add(length)?)?;
            return Some(bytes[self.header_size..].to_vec());
        }
        let (head, _) = decode(0, self.header_size)?;
        let n_header = self
            .header_size
            .checked_mul(self.integer(&head)?.checked_add(3)?)?;
        let (header, end) = decode(0, n_header)?;
        let total = self
            .packed_sizes(&header)?
            .iter()
            .try_fold(0usize, |sum, size| sum.checked_add(*size))?;
        let (packed, _) = decode(end, total)?;
        self.unpack(&header, &packed)
    }

    /// Decodes the array at the beginning of raw bytes.
    pub fn raw(self, bytes: &[u8]) -> Option<Vec<u8>> {
        let first = self.integer(bytes)?;
        if !self.compressed {
            return bytes
                .get(self.header_size..self.header_size.checked_add(first)?)
                .map(<[u8]>::to_vec);
        }
        let n_header = self.header_size.checked_mul(first.checked_add(3)?)?;
        self.unpack(bytes.get(..n_header)?, &bytes[n_header..])
    }

    fn packed_sizes(self, header: &[u8]) -> Option<Vec<usize>> {
        header
            .chunks_exact(self.header_size)
            .skip(3)
            .map(|n| self.integer(n))
            .collect()
    }

    fn unpack(self, header: &[u8], packed: &[u8]) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let mut at = 0usize;
        for size in self.packed_sizes(header)? {
            let end = at.checked_add(size)?;
            flate2::read::ZlibDecoder::new(packed.get(at..end)?)
                .read_to_end(&mut bytes)
                .ok()?;
            at = end;
        }
        Some(bytes)
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
