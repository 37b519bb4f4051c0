//! Fast parser of decimal numbers.

/// Number of decimal digits that the mantissa of a float represents exactly.
const EXACT_DIGITS: u32 = 15;

/// Sign between the units and the tenths of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Decimal {
    /// A point, as in 1.5.
    #[default]
    Point,
    /// A comma, as in 1,5.
    Comma,
}

impl Decimal {
    pub(crate) fn byte(self) -> u8 {
        match self {
            Self::Point => b'.',
            Self::Comma => b',',
        }
    }

    /// Name of the sign in messages.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::Comma => "comma",
        }
    }
}

/// Parses a finite decimal number. With up to 15 digits and powers of ten up to 22, mantissa and
/// power are exact, so that one division rounds correctly (Clinger 1990, PLDI, section 3). All
/// other numbers use the general parser.
#[must_use]
pub fn number(text: &[u8], decimal: Decimal) -> Option<f64> {
    let (negative, digits) = match text.first()? {
        b'-' => (true, &text[1..]),
        b'+' => (false, &text[1..]),
        _ => (false, text),
    };
    let sign = decimal.byte();
    let (mut mantissa, mut n_digits, mut n_decimals, mut point) = (0_u64, 0_u32, 0_usize, false);
    for byte in digits {
        match byte {
            b'0'..=b'9' => {
                mantissa = mantissa
                    .wrapping_mul(10)
                    .wrapping_add(u64::from(byte - b'0'));
                n_digits += u32::from(mantissa > 0);
                n_decimals += usize::from(point);
            }
            _ if *byte == sign && !point => point = true,
            _ => return slow(text, decimal),
        }
    }
    if n_digits > EXACT_DIGITS || n_decimals >= POWERS.len() || digits.len() == usize::from(point) {
        return slow(text, decimal);
    }
    let value = mantissa as f64 / POWERS[n_decimals];
    Some(if negative { -value } else { value })
}

const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

fn slow(text: &[u8], decimal: Decimal) -> Option<f64> {
    let text = std::str::from_utf8(text).ok()?;
    let parsed = match decimal {
        Decimal::Point => text.parse::<f64>(),
        Decimal::Comma if text.contains('.') => return None,
        Decimal::Comma => text.replacen(',', ".", 1).parse::<f64>(),
    };
    parsed.ok().filter(|value| value.is_finite())
}

/// Whether a cell stands for a lost sample.
pub(crate) fn is_missing(cell: &[u8]) -> bool {
    const WORDS: [&[u8]; 13] = [
        b"", b"nan", b"na", b"n/a", b"n.a.", b"null", b"none", b"#n/a", b"#num!", b"#div/0!", b"-",
        b"--", b"---",
    ];
    WORDS.iter().any(|word| cell.eq_ignore_ascii_case(word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_the_standard_library_reads_them() {
        for text in [
            "0",
            "-0.0",
            "12.345",
            "0.1",
            "3.",
            ".5",
            "123456789012345",
            "1234567890123456789",
            "1e-3",
            "-7.25E2",
            "0.000001",
            "99.99999999999999",
            "+4",
        ] {
            let expected: f64 = text.parse().unwrap();
            assert_eq!(
                number(text.as_bytes(), Decimal::Point),
                Some(expected),
                "{text}"
            );
            let with_comma = text.replace('.', ",");
            assert_eq!(
                number(with_comma.as_bytes(), Decimal::Comma),
                Some(expected),
                "{text}"
            );
        }
        for text in ["", "-", ".", "1,5", "1.2.3", "abc", "inf", "nan", "--1"] {
            assert_eq!(number(text.as_bytes(), Decimal::Point), None, "{text}");
        }
        for text in ["", ",", "1.5", "1.000,5", "1,2,3"] {
            assert_eq!(number(text.as_bytes(), Decimal::Comma), None, "{text}");
        }
    }
}
