//! Packed samples of WFDB's signal files.

/// Format of a signal file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// Eight-bit differences from the sample before.
    Differences,
    /// Two's complement, least significant byte first, with this number of bytes.
    Little(usize),
    /// Two's complement of 16 bits, most significant byte first.
    Big,
    /// Offset binary of this number of bytes.
    Offset(usize),
    /// Pairs of twelve-bit samples in three bytes.
    Pairs,
    /// Triples of ten-bit samples in four bytes, in two orders.
    Triples(bool),
}

impl Format {
    pub(crate) fn of(number: u16) -> Option<Self> {
        Some(match number {
            8 => Self::Differences,
            16 => Self::Little(2),
            24 => Self::Little(3),
            32 => Self::Little(4),
            61 => Self::Big,
            80 => Self::Offset(1),
            160 => Self::Offset(2),
            212 => Self::Pairs,
            310 => Self::Triples(true),
            311 => Self::Triples(false),
            _ => return None,
        })
    }

    pub(crate) fn number(self) -> u16 {
        match self {
            Self::Differences => 8,
            Self::Little(bytes) => 8 * bytes as u16,
            Self::Big => 61,
            Self::Offset(bytes) => {
                if bytes == 1 {
                    80
                } else {
                    160
                }
            }
            Self::Pairs => 212,
            Self::Triples(true) => 310,
            Self::Triples(false) => 311,
        }
    }

    /// Value that marks a lost sample.
    pub(crate) fn lost(self) -> Option<i32> {
        match self {
            Self::Differences => None,
            Self::Little(2) | Self::Big | Self::Offset(2) => Some(-32_768),
            Self::Little(3) => Some(-8_388_608),
            Self::Little(_) => Some(i32::MIN),
            Self::Offset(_) => Some(-128),
            Self::Pairs => Some(-2048),
            Self::Triples(_) => Some(-512),
        }
    }
}

/// Samples of all signals of a file in their order; `None` for a lost one.
/// - `firsts`: first value of each signal, for differences
pub(crate) fn decode(bytes: &[u8], format: Format, firsts: &[i32]) -> Vec<Option<i32>> {
    let values: Vec<i32> = match format {
        Format::Differences => {
            let mut sums = firsts.to_vec();
            let n = sums.len().max(1);
            bytes
                .iter()
                .enumerate()
                .map(|(i, byte)| {
                    let sum = &mut sums[i % n];
                    *sum = sum.saturating_add(i32::from(i8::from_le_bytes([*byte])));
                    *sum
                })
                .collect()
        }
        Format::Little(2) => bytes
            .chunks_exact(2)
            .map(|b| i32::from(i16::from_le_bytes([b[0], b[1]])))
            .collect(),
        Format::Little(3) => bytes
            .chunks_exact(3)
            .map(|b| i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8)
            .collect(),
        Format::Little(_) => bytes
            .chunks_exact(4)
            .map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect(),
        Format::Big => bytes
            .chunks_exact(2)
            .map(|b| i32::from(i16::from_be_bytes([b[0], b[1]])))
            .collect(),
        Format::Offset(1) => bytes.iter().map(|b| i32::from(*b) - 128).collect(),
        Format::Offset(_) => bytes
            .chunks_exact(2)
            .map(|b| i32::from(u16::from_le_bytes([b[0], b[1]])) - 32_768)
            .collect(),
        Format::Pairs => {
            let mut values: Vec<i32> = Vec::with_capacity(2 * bytes.len() / 3 + 2);
            for b in bytes.chunks(3) {
                let byte = |i: usize| i32::from(b.get(i).copied().unwrap_or(0));
                if b.len() >= 2 {
                    values.push(signed(byte(0) | (byte(1) & 0x0f) << 8, 12));
                }
                if b.len() == 3 {
                    values.push(signed(byte(2) | (byte(1) & 0xf0) << 4, 12));
                }
            }
            values
        }
        Format::Triples(split) => {
            let mut values = Vec::with_capacity(3 * bytes.len() / 4);
            for b in bytes.chunks_exact(4) {
                let low = i32::from(u16::from_le_bytes([b[0], b[1]]));
                let high = i32::from(u16::from_le_bytes([b[2], b[3]]));
                if split {
                    // Bits 1 to 10 of both words, and bits 11 to 15 of both for the third sample.
                    values.push(signed(low >> 1 & 0x3ff, 10));
                    values.push(signed(high >> 1 & 0x3ff, 10));
                    values.push(signed((low >> 11 & 0x1f) | (high >> 11 & 0x1f) << 5, 10));
                } else {
                    // Thirty bits from the lowest one on.
                    let all = low | high << 16;
                    values.push(signed(all & 0x3ff, 10));
                    values.push(signed(all >> 10 & 0x3ff, 10));
                    values.push(signed(all >> 20 & 0x3ff, 10));
                }
            }
            values
        }
    };
    let lost = format.lost();
    values
        .into_iter()
        .map(|value| (Some(value) != lost).then_some(value))
        .collect()
}

/// Number of `bits` in two's complement.
fn signed(value: i32, bits: u32) -> i32 {
    let shift = 32 - bits;
    value << shift >> shift
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(number: u16, bytes: &[u8]) -> Vec<Option<i32>> {
        decode(bytes, Format::of(number).unwrap(), &[100, 200])
    }

    #[test]
    fn every_format_is_decoded() {
        assert_eq!(
            of(16, &[0x34, 0x12, 0xff, 0xff, 0x00, 0x80]),
            [Some(0x1234), Some(-1), None]
        );
        assert_eq!(of(61, &[0x12, 0x34, 0xff, 0xfe]), [Some(0x1234), Some(-2)]);
        assert_eq!(
            of(24, &[0x01, 0x00, 0x80, 0xff, 0xff, 0xff]),
            [Some(-8_388_607), Some(-1)]
        );
        assert_eq!(of(32, &[0xfe, 0xff, 0xff, 0xff]), [Some(-2)]);
        assert_eq!(of(80, &[0x80, 0xff, 0x00]), [Some(0), Some(127), None]);
        assert_eq!(of(160, &[0x00, 0x80, 0x01, 0x80]), [Some(0), Some(1)]);
        assert_eq!(
            of(8, &[0xff, 0x02, 0x01, 0x80]),
            [Some(99), Some(202), Some(100), Some(74)]
        );
        // The first bytes of record 100 of the MIT-BIH database: 995 and 1011.
        assert_eq!(of(212, &[0xe3, 0x33, 0xf3]), [Some(995), Some(1011)]);
        assert_eq!(of(212, &[0x00, 0x88, 0x00]), [None, None]);
        assert_eq!(
            of(311, &[0x01, 0x08, 0x30, 0x00]),
            [Some(1), Some(2), Some(3)]
        );
        assert_eq!(
            of(310, &[0x02, 0x08, 0x04, 0x08]),
            [Some(1), Some(2), Some(33)]
        );
        for number in [8, 16, 24, 32, 61, 80, 160, 212, 310, 311] {
            assert_eq!(Format::of(number).unwrap().number(), number);
        }
        assert_eq!(Format::of(508), None);
    }
}
