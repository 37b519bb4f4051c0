//! Any separator, decimal sign and encoding gives the same numbers.

use std::path::Path;

use cardiotwin_lab_files::{Request, Wanted, read};
use proptest::prelude::*;

fn wanted() -> [Wanted; 2] {
    [
        Wanted::required("time"),
        Wanted {
            required: true,
            ..Wanted::new("lv_pressure")
        },
    ]
}

#[derive(Debug, Clone, Copy)]
enum Encoding {
    Utf8,
    Utf8WithMark,
    Utf16,
    Utf16Big,
    Windows,
}

fn encode(text: &str, encoding: Encoding) -> Vec<u8> {
    let wide = |big: bool| -> Vec<u8> {
        format!("\u{feff}{text}")
            .encode_utf16()
            .flat_map(|u| {
                if big {
                    u.to_be_bytes()
                } else {
                    u.to_le_bytes()
                }
            })
            .collect()
    };
    match encoding {
        Encoding::Utf8 => text.into(),
        Encoding::Utf8WithMark => format!("\u{feff}{text}").into(),
        Encoding::Utf16 => wide(false),
        Encoding::Utf16Big => wide(true),
        Encoding::Windows => encoding_rs::WINDOWS_1252.encode(text).0.into_owned(),
    }
}

fn form() -> impl Strategy<Value = (char, char, Encoding, bool)> {
    let signs = prop_oneof![
        Just((',', '.')),
        Just((';', '.')),
        Just((';', ',')),
        Just(('\t', '.')),
        Just(('\t', ',')),
    ];
    let encodings = prop_oneof![
        Just(Encoding::Utf8),
        Just(Encoding::Utf8WithMark),
        Just(Encoding::Utf16),
        Just(Encoding::Utf16Big),
        Just(Encoding::Windows),
    ];
    (signs, encodings, any::<bool>())
        .prop_map(|((separator, decimal), encoding, crlf)| (separator, decimal, encoding, crlf))
}

proptest! {
    #[test]
    fn numbers_survive((separator, decimal, encoding, crlf) in form(),
                       values in prop::collection::vec(prop_oneof![9 => (-300.0..300.0f64).prop_map(Some), 1 => Just(None)], 5..60),
                       preamble in any::<bool>()) {
        let end = if crlf { "\r\n" } else { "\n" };
        let mut text = String::new();
        if preamble {
            text += &format!("Größe; é{end}{end}");
        }
        text += &format!("Zeit (s){separator}LVP (mmHg){separator}Note{end}");
        for (i, value) in values.iter().enumerate() {
            let number = |v: f64| v.to_string().replace('.', &decimal.to_string());
            let cell = value.map(number).unwrap_or_default();
            text += &format!("{}{separator}{cell}{separator}{end}", number(i as f64 * 0.004 + 0.001));
        }
        let bytes = encode(&text, encoding);
        let wanted = wanted();
        let request = Request { file: Path::new("catheter.txt"), wanted: &wanted, format: None, sheet: None, block: None };
        let reading = read(&bytes, &request, &mut |_| Err(String::new()));
        let table = reading.table.ok_or_else(|| TestCaseError::fail(format!("{:#?}\n{text}", reading.problems)))?;
        prop_assert_eq!(table.columns["lv_pressure"].len(), values.len());
        for (read, expected) in table.columns["lv_pressure"].iter().zip(&values) {
            prop_assert!(expected.map_or(read.is_nan(), |e| e == *read), "{} {:?}", read, expected);
        }
        prop_assert!((table.columns["time"][1] - 5.0).abs() < 1e-9);
    }

    #[test]
    fn any_bytes_are_refused_without_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..600), text in "[0-9,;.\\t\\n a-zA-Z=#()\\[\\]]{0,400}",
                                             format in 0..9_usize) {
        use cardiotwin_vocabulary::preparation::FileFormat as F;
        let formats = [F::Labchart, F::Csv, F::ExcelCsv, F::Excel, F::Millar, F::Cvi42, F::Segment, F::Wfdb, F::Edf];
        let wanted = wanted();
        let head = b"0       ".to_vec();
        for content in [bytes.clone(), text.into_bytes(), [head, bytes].concat()] {
            for format in [None, Some(formats[format])] {
                let request = Request { file: Path::new("catheter.txt"), wanted: &wanted, format, sheet: None, block: None };
                let reading = read(&content, &request, &mut |_| Ok(content.clone()));
                prop_assert!(reading.table.is_some() || !reading.problems.is_empty());
            }
        }
    }
}
