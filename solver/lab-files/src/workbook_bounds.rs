//! Bounds of a workbook: a file of a few kilobytes may ask for more memory than any computer has.
//!
//! A sheet is kept as a table of all cells between its first and its last one, and the parts of a
//! workbook are packed. Both are counted, without being kept, before anything is read.

use std::io::{BufRead as _, BufReader, Cursor, Read, Seek};

use calamine::{DataRef, Sheets};

use crate::compound_file;

/// Cells of a sheet, between the first and the last one: all rows of Excel with 32 columns.
const MAX_CELLS: u64 = 32 << 20;
/// Bytes of all parts of a workbook together, unpacked.
const MAX_UNPACKED: u64 = 1 << 30;
/// Unpacked bytes that may come of any packed file.
const FREE_UNPACKED: u64 = 64 << 20;
/// Unpacked bytes for each packed one, beyond [`FREE_UNPACKED`]. Tables of numbers have about ten.
const MAX_RATIO: u64 = 200;
/// Bytes of texts in the cells of a sheet: a text that many cells share counts for each of them.
const MAX_TEXT: u64 = 1 << 30;
/// Records of `.xls`: beginning of a sheet; cells with a value; several numbers in a row.
const BEGIN: u32 = 0x0809;
const CELLS: [u32; 8] = [
    0x0006, 0x00BD, 0x00D6, 0x00FD, 0x0203, 0x0204, 0x0205, 0x027E,
];
const MULTIPLE: u32 = 0x00BD;
/// The part of an OpenDocument workbook that holds its tables.
const CONTENT: &str = "content.xml";

/// Reason why a workbook is not read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// It asks for too much.
    TooLarge {
        /// What was found.
        found: String,
        /// The limit.
        expected: String,
    },
    /// It cannot be read.
    Damaged(String),
}

fn too_large(found: String, expected: String) -> Refused {
    Refused::TooLarge { found, expected }
}

fn damaged(error: impl ToString) -> Refused {
    Refused::Damaged(error.to_string())
}

fn mib(bytes: u64) -> u64 {
    bytes >> 20
}

/// Counts the unpacked bytes of a packed workbook, and the cells of an OpenDocument one.
///
/// # Errors
/// [`Refused`] with the limit that is exceeded, or for a file that is not whole.
pub fn check_parts(bytes: &[u8]) -> Result<(), Refused> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).map_err(damaged)?;
    let packed = bytes.len() as u64;
    let allowed = MAX_UNPACKED.min(FREE_UNPACKED.max(packed.saturating_mul(MAX_RATIO)));
    let mut left = allowed;
    for index in 0..archive.len() {
        let mut part = archive.by_index(index).map_err(damaged)?;
        let is_content = part.name() == CONTENT;
        // One byte more than is allowed shows an excess.
        let mut bounded = (&mut part).take(left + 1);
        if is_content {
            check_content(&mut bounded)?;
        }
        std::io::copy(&mut bounded, &mut std::io::sink()).map_err(damaged)?;
        let unpacked = left + 1 - bounded.limit();
        left = left.checked_sub(unpacked).ok_or_else(|| {
            too_large(
                format!(
                    "a workbook of {packed} bytes that unpacks to more than {} MiB",
                    mib(allowed)
                ),
                format!(
                    "at most {} MiB, and {MAX_RATIO} times the file's size",
                    mib(MAX_UNPACKED)
                ),
            )
        })?;
    }
    Ok(())
}

/// Counts the cells of all sheets of an `.xls` file, which are read together. Damage is
/// reported where it is read.
///
/// # Errors
/// [`Refused`] with the limit that is exceeded.
pub fn check_records(bytes: &[u8]) -> Result<(), Refused> {
    let Some(stream) = compound_file::workbook(bytes) else {
        return Ok(());
    };
    let (mut extent, mut before, mut at) = (Extent::default(), 0, 0);
    let word = |at: usize| {
        Some(u32::from(u16::from_le_bytes([
            *stream.get(at)?,
            *stream.get(at + 1)?,
        ])))
    };
    while let (Some(kind), Some(length)) = (word(at), word(at + 2)) {
        let body = at + 4;
        let end = body + length as usize;
        match kind {
            BEGIN => {
                before += extent.n_cells();
                extent = Extent::default();
            }
            _ if CELLS.contains(&kind) => {
                if let (Some(row), Some(column)) = (word(body), word(body + 2)) {
                    extent.reach(row, column)?;
                    // Several numbers in a row name the last column, too.
                    if let (MULTIPLE, Some(last)) = (kind, word(end.saturating_sub(2))) {
                        extent.reach(row, last)?;
                    }
                }
            }
            _ => {}
        }
        check_sum(before + extent.n_cells())?;
        at = end;
    }
    Ok(())
}

/// Checks the number of cells in a sheet of Excel before a table is made of them. Workbooks of
/// OpenDocument are checked by their parts.
///
/// # Errors
/// [`Refused`] with the limit that is exceeded, or for a sheet that cannot be read.
pub fn check_sheet<R: Read + Seek>(book: &mut Sheets<R>, sheet: &str) -> Result<(), Refused> {
    let mut extent = Extent::default();
    match book {
        Sheets::Xlsx(book) => match book.worksheet_cells_reader(sheet) {
            Ok(mut cells) => {
                while let Some(cell) = cells.next_cell().map_err(damaged)? {
                    extent.take(cell.get_position(), cell.get_value())?;
                }
            }
            // A sheet of charts is reported where it is read.
            Err(_) => return Ok(()),
        },
        Sheets::Xlsb(book) => match book.worksheet_cells_reader(sheet) {
            Ok(mut cells) => {
                while let Some(cell) = cells.next_cell().map_err(damaged)? {
                    extent.take(cell.get_position(), cell.get_value())?;
                }
            }
            Err(_) => return Ok(()),
        },
        Sheets::Xls(_) | Sheets::Ods(_) => {}
    }
    Ok(())
}

/// The cells of a sheet that have a value.
#[derive(Debug, Default)]
struct Extent {
    /// First and last row and column.
    bounds: Option<((u32, u32), (u32, u32))>,
    text: u64,
}

impl Extent {
    /// Takes up the place of a cell with a value.
    fn reach(&mut self, row: u32, column: u32) -> Result<(), Refused> {
        let (first, last) = self.bounds.unwrap_or(((row, column), (row, column)));
        let first = (first.0.min(row), first.1.min(column));
        let last = (last.0.max(row), last.1.max(column));
        self.bounds = Some((first, last));
        let (rows, columns) = self.size();
        check_extent(rows, columns)
    }

    /// Rows and columns from the first to the last cell.
    fn size(&self) -> (u64, u64) {
        let n = |first: u32, last: u32| u64::from(last - first) + 1;
        self.bounds.map_or((0, 0), |(first, last)| {
            (n(first.0, last.0), n(first.1, last.1))
        })
    }

    fn n_cells(&self) -> u64 {
        let (rows, columns) = self.size();
        rows * columns
    }

    fn take(&mut self, (row, column): (u32, u32), value: &DataRef<'_>) -> Result<(), Refused> {
        if matches!(value, DataRef::Empty) {
            return Ok(());
        }
        self.reach(row, column)?;
        self.text += match value {
            DataRef::String(text) => text.len() as u64,
            DataRef::SharedString(text) => text.len() as u64,
            _ => 0,
        };
        match self.text > MAX_TEXT {
            true => Err(too_large(
                format!("a sheet with more than {} MiB of text", mib(MAX_TEXT)),
                "a sheet of numbers".to_owned(),
            )),
            false => Ok(()),
        }
    }
}

fn check_extent(rows: u64, columns: u64) -> Result<(), Refused> {
    match rows.saturating_mul(columns) <= MAX_CELLS {
        true => Ok(()),
        false => Err(too_large(
            format!(
                "a sheet of {rows} rows and {columns} columns between its first and its last cell"
            ),
            format!("at most {MAX_CELLS} cells"),
        )),
    }
}

fn check_sum(cells: u64) -> Result<(), Refused> {
    match cells <= MAX_CELLS {
        true => Ok(()),
        false => Err(too_large(
            format!("sheets of more than {MAX_CELLS} cells together"),
            format!("at most {MAX_CELLS} cells"),
        )),
    }
}

/// Counts the cells of all tables in the content of an OpenDocument workbook, which are read
/// together: with all repetitions, up to the last cell that has a value.
fn check_content(content: impl Read) -> Result<(), Refused> {
    let mut content = BufReader::new(content);
    let (mut table, mut before) = (Table::default(), 0_u64);
    let mut tag = Vec::new();
    loop {
        tag.clear();
        if content.read_until(b'>', &mut tag).map_err(damaged)? == 0 {
            return Ok(());
        }
        let Some(at) = tag.iter().rposition(|byte| *byte == b'<') else {
            continue;
        };
        let finished = table.take(&tag[at..]);
        before = before.saturating_add(finished);
        check_extent(table.rows, table.columns)?;
        check_sum(before.saturating_add(table.rows.saturating_mul(table.columns)))?;
    }
}

/// A table of OpenDocument as far as it was read.
#[derive(Debug, Default)]
struct Table {
    /// Rows up to the last one with a value.
    rows: u64,
    /// Columns up to the last one with a value, of all rows.
    columns: u64,
    /// Rows up to the present one.
    at_row: u64,
    /// Cells of the present row so far.
    at_column: u64,
}

impl Table {
    /// Takes up a tag. Returns the number of cells of the table before, where another one begins.
    fn take(&mut self, tag: &[u8]) -> u64 {
        let is = |name: &[u8]| {
            tag.strip_prefix(name).is_some_and(|rest| {
                matches!(rest.first(), Some(b' ' | b'>' | b'/' | b'\n' | b'\t'))
            })
        };
        if is(b"<table:table") {
            let finished = std::mem::take(self);
            return finished.rows.saturating_mul(finished.columns);
        } else if is(b"<table:table-row") {
            let repeated = number(tag, b"table:number-rows-repeated=");
            self.at_row = self.at_row.saturating_add(repeated);
            self.at_column = 0;
        } else if is(b"<table:table-cell") || is(b"<table:covered-table-cell") {
            let repeated = number(tag, b"table:number-columns-repeated=");
            self.at_column = self.at_column.saturating_add(repeated);
            let has_value = !tag.ends_with(b"/>") || contains(tag, b"office:");
            if has_value {
                self.columns = self.columns.max(self.at_column);
                self.rows = self.at_row;
            }
        }
        0
    }
}

fn contains(text: &[u8], what: &[u8]) -> bool {
    text.windows(what.len()).any(|window| window == what)
}

/// The number of an attribute; 1 without it.
fn number(tag: &[u8], attribute: &[u8]) -> u64 {
    let Some(at) = tag
        .windows(attribute.len())
        .position(|window| window == attribute)
    else {
        return 1;
    };
    let digits: Vec<u8> = tag[at + attribute.len()..]
        .iter()
        .skip(1)
        .copied()
        .take_while(u8::is_ascii_digit)
        .collect();
    // A number beyond all bounds is as good as the largest one.
    match std::str::from_utf8(&digits) {
        Ok("") | Err(_) => 1,
        Ok(digits) => digits.parse().unwrap_or(u64::MAX),
    }
}

#[cfg(test)]
mod tests {
    use zip::write::SimpleFileOptions;

    use super::*;

    /// Writes the content of a part.
    type Part<'a> = &'a dyn Fn(&mut dyn std::io::Write);

    fn packed(parts: &[(&str, Part<'_>)]) -> Vec<u8> {
        let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
        for (name, write) in parts {
            writer
                .start_file(*name, SimpleFileOptions::default())
                .unwrap();
            write(&mut writer);
        }
        writer.finish().unwrap().into_inner()
    }

    fn workbook(sheet: &str, strings: &str) -> Vec<u8> {
        let text = |text: String| {
            move |out: &mut dyn std::io::Write| out.write_all(text.as_bytes()).unwrap()
        };
        let book = r#"<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships"><sheets><sheet name="S" sheetId="1" r:id="rId1"/></sheets></workbook>"#;
        let kind = "http://schemas.openxmlformats.org/officeDocument/2006/relationships";
        let relations = format!(
            r#"<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="rId1" Type="{kind}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>"#
        );
        let sheet = format!(
            r#"<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{sheet}</sheetData></worksheet>"#
        );
        let strings = format!(
            r#"<sst xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">{strings}</sst>"#
        );
        packed(&[
            ("xl/workbook.xml", &text(book.to_owned())),
            ("xl/_rels/workbook.xml.rels", &text(relations)),
            ("xl/sharedStrings.xml", &text(strings)),
            ("xl/worksheets/sheet1.xml", &text(sheet)),
        ])
    }

    fn checked(bytes: &[u8]) -> Result<(), Refused> {
        check_parts(bytes)?;
        let mut book = calamine::open_workbook_auto_from_rs(Cursor::new(bytes)).unwrap();
        check_sheet(&mut book, "S")
    }

    fn found(bytes: &[u8]) -> String {
        match checked(bytes) {
            Err(Refused::TooLarge { found, .. }) => found,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn two_cells_at_the_ends_of_a_sheet_are_refused_before_a_table_is_made() {
        let cells = r#"<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="XFD1048576"><v>2</v></c></row>"#;
        let bytes = workbook(cells, "");
        assert!(bytes.len() < 6_000, "{}", bytes.len());
        assert_eq!(
            found(&bytes),
            "a sheet of 1048576 rows and 16384 columns between its first and its last cell"
        );
        let sane = r#"<row r="1"><c r="A1"><v>1</v></c></row><row r="1048576"><c r="AF1048576"><v>2</v></c></row>"#;
        assert_eq!(checked(&workbook(sane, "")), Ok(()));
    }

    #[test]
    fn what_unpacks_to_two_hundred_times_its_size_is_refused() {
        let spaces = |out: &mut dyn std::io::Write| {
            let block = vec![b' '; 1 << 20];
            (0..80).for_each(|_| out.write_all(&block).unwrap());
        };
        let bytes = packed(&[("xl/worksheets/sheet1.xml", &spaces)]);
        assert!(bytes.len() < 200_000, "{}", bytes.len());
        let found = found(&bytes);
        assert!(
            found.ends_with("that unpacks to more than 64 MiB"),
            "{found}"
        );
    }

    #[test]
    fn a_long_text_that_many_cells_share_counts_for_each() {
        let text = format!("<si><t>{}</t></si>", "x".repeat(1 << 20));
        let rows: String = (1..=1025)
            .map(|n| format!(r#"<row r="{n}"><c r="A{n}" t="s"><v>0</v></c></row>"#))
            .collect();
        let bytes = workbook(&rows, &text);
        assert_eq!(found(&bytes), "a sheet with more than 1024 MiB of text");
    }

    #[test]
    fn repetitions_of_opendocument_are_cells() {
        let sheet = |rows: &str| {
            let content = format!("<table:table table:name=\"S\">{rows}</table:table>");
            let content = move |out: &mut dyn std::io::Write| {
                out.write_all(content.as_bytes()).unwrap();
            };
            check_parts(&packed(&[("content.xml", &content)]))
        };
        let value = r#"office:value-type="float" office:value="1""#;
        // Programs fill a sheet with repeated empty cells to its end.
        let usual = format!(
            r#"<table:table-row><table:table-cell {value}/><table:table-cell table:number-columns-repeated="16383"/></table:table-row><table:table-row table:number-rows-repeated="1048575"><table:table-cell table:number-columns-repeated="16384"/></table:table-row>"#
        );
        assert_eq!(sheet(&usual), Ok(()));
        let wide = format!(
            r#"<table:table-row><table:table-cell table:number-columns-repeated="99999999999"/><table:table-cell {value}/></table:table-row>"#
        );
        let long = format!(
            r#"<table:table-row table:number-rows-repeated="40000000"><table:table-cell {value}/></table:table-row>"#
        );
        for hostile in [wide, long] {
            let refused = sheet(&hostile);
            assert!(
                matches!(refused, Err(Refused::TooLarge { .. })),
                "{refused:?}"
            );
        }
    }

    /// A compound file with one stream of seven sectors: table of sectors, directory, stream.
    fn compound(stream: &[u8]) -> Vec<u8> {
        let word = |n: u32| n.to_le_bytes();
        let mut header = [0_u8; 512];
        header[..8].copy_from_slice(&[0xd0, 0xcf, 0x11, 0xe0, 0xa1, 0xb1, 0x1a, 0xe1]);
        header[30] = 9; // sectors of 512 bytes
        header[32] = 6;
        header[48..52].copy_from_slice(&word(1));
        header[56..60].copy_from_slice(&word(512)); // smaller streams share sectors
        header[60..64].copy_from_slice(&word(u32::MAX - 1));
        header[68..72].copy_from_slice(&word(u32::MAX - 1));
        header[76..80].copy_from_slice(&word(0));
        header[80..].fill(0xff);
        let mut table = vec![u32::MAX; 128];
        table[0] = u32::MAX - 2;
        table[1] = u32::MAX - 1;
        (2..8).for_each(|n| table[n] = n as u32 + 1);
        table[8] = u32::MAX - 1;
        let mut entry = [0_u8; 512];
        for (place, letter) in "Workbook".bytes().enumerate() {
            entry[2 * place] = letter;
        }
        entry[64] = 18;
        entry[66] = 2;
        entry[116..120].copy_from_slice(&word(2));
        entry[120..124].copy_from_slice(&word(7 * 512));
        let mut content = stream.to_vec();
        content.resize(7 * 512, 0);
        let table: Vec<u8> = table.into_iter().flat_map(word).collect();
        [&header[..], &table, &entry, &content].concat()
    }

    #[test]
    fn far_cells_of_the_old_format_are_refused() {
        let record = |kind: u16, words: &[u16]| -> Vec<u8> {
            let length = 2 * words.len() as u16;
            let all = [&[kind, length], words].concat();
            all.iter().flat_map(|word| word.to_le_bytes()).collect()
        };
        let cell = |row: u16, column: u16| record(0x0203, &[row, column, 0, 0, 0, 0, 0]);
        let begin = || record(0x0809, &[0x0600, 0x0010]);
        let sheet = |row: u16, column: u16| [begin(), cell(0, 0), cell(row, column)].concat();
        assert_eq!(check_records(&compound(&sheet(65_535, 255))), Ok(()));
        for (stream, wanted) in [
            (
                sheet(65_535, 65_535),
                "a sheet of 65536 rows and 65536 columns between its first and its last cell",
            ),
            (
                [
                    begin(),
                    record(0x00BD, &[9, 0, 0, 0, 60_000]),
                    cell(65_000, 0),
                ]
                .concat(),
                "a sheet of 64992 rows and 60001 columns between its first and its last cell",
            ),
            (
                sheet(65_535, 255).repeat(3),
                "sheets of more than 33554432 cells together",
            ),
        ] {
            match check_records(&compound(&stream)) {
                Err(Refused::TooLarge { found, .. }) => assert_eq!(found, wanted),
                other => panic!("{other:?}"),
            }
        }
        // The reader reports a file that is no compound file.
        assert_eq!(check_records(b"\xd0\xcf\x11\xe0"), Ok(()));
    }
}
