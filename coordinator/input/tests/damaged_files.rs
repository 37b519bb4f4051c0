//! Damaged files: every reader refuses them or reads them, without a panic and in bounded time.
//!
//! `ROUNDS=1000 cargo test … --test damaged_files` damages each file of the fixtures that often.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use cardiotwin_lab_files::{Request, Wanted, read};
use cardiotwin_mesh::files::{self, LengthUnit};

/// Longest time for one file. A damaged count must not make a reader go on for ever.
const LONGEST: Duration = Duration::from_secs(10);

/// Numbers that look random and are the same in each run (Marsaglia 2003, J Stat Softw 8:14).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// A copy with some bytes changed, cut, doubled, or replaced by what often breaks readers.
fn damaged(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    const WORDS: [&[u8]; 12] = [
        b"-1",
        b"0",
        b"99999999999999999999",
        b"1e308",
        b"nan",
        b"",
        b"\0\0\0\0",
        b"\xff\xff\xff\xff",
        b"-2147483648",
        b"\n",
        b"\t",
        b"4294967295",
    ];
    let mut out = bytes.to_vec();
    for _ in 0..=random.below(4) {
        if out.is_empty() {
            break;
        }
        let at = if random.below(2) == 0 {
            // Headers are where counts stand.
            random.below(out.len().min(1500))
        } else {
            random.below(out.len())
        };
        match random.below(5) {
            0 => out[at] = random.next() as u8,
            1 => out.truncate(at),
            2 => {
                let end = (at + 1 + random.below(40)).min(out.len());
                out.drain(at..end);
            }
            3 => {
                let end = (at + 1 + random.below(200)).min(out.len());
                let part = out[at..end].to_vec();
                out.splice(at..at, part);
            }
            _ => {
                let end = (at + random.below(9)).min(out.len());
                let word = WORDS[random.below(WORDS.len())];
                out.splice(at..end, word.iter().copied());
            }
        }
    }
    out
}

fn fixtures() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/public-reports");
    let mut found = Vec::new();
    let mut folders = vec![root];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn ending(path: &Path) -> &str {
    path.extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default()
}

#[test]
fn no_damage_makes_a_reader_panic_or_go_on() {
    let rounds: usize = std::env::var("ROUNDS")
        .ok()
        .and_then(|n| n.parse().ok())
        .unwrap_or(6);
    let mut random = Random(0x5eed_1234_abcd);
    let (mut n, mut read_well) = (0, 0);
    let folder = tempfile::tempdir().unwrap();
    for path in fixtures() {
        let bytes = std::fs::read(&path).unwrap();
        for _ in 0..rounds {
            let content = damaged(&bytes, &mut random);
            let began = Instant::now();
            let well = match ending(&path) {
                "csv" | "txt" | "xlsx" | "edf" | "hea" => {
                    let wanted = [
                        Wanted::required("time"),
                        Wanted::new("lv_pressure"),
                        Wanted::new("aortic_pressure"),
                        Wanted::new("ecg"),
                        Wanted::new("volume"),
                    ];
                    let request = Request {
                        file: &path,
                        wanted: &wanted,
                        format: None,
                        sheet: None,
                        block: None,
                    };
                    let beside = path.parent().unwrap().to_owned();
                    let mut beside = |name: &str| {
                        std::fs::read(beside.join(name)).map_err(|error| error.to_string())
                    };
                    let reading = read(&content, &request, &mut beside);
                    // What is not read is said.
                    assert!(
                        reading.table.is_some() || !reading.problems.is_empty(),
                        "{}",
                        path.display()
                    );
                    reading.table.is_some()
                }
                "vtu" => files::vtu::parse(&content, &path, LengthUnit::Millimetre).is_ok(),
                "msh" => String::from_utf8(content).is_ok_and(|text| {
                    files::gmsh::parse(&text, &path, LengthUnit::Millimetre).is_ok()
                }),
                "elem" | "pts" | "lon" | "surf" => {
                    let source = path.parent().unwrap();
                    for entry in std::fs::read_dir(source).unwrap() {
                        let from = entry.unwrap().path();
                        std::fs::copy(&from, folder.path().join(from.file_name().unwrap()))
                            .unwrap();
                    }
                    std::fs::write(folder.path().join(path.file_name().unwrap()), &content)
                        .unwrap();
                    files::read(&folder.path().join("heart"), LengthUnit::Micrometre).is_ok()
                }
                _ => continue,
            };
            let took = began.elapsed();
            assert!(took < LONGEST, "{}: {took:?}", path.display());
            n += 1;
            read_well += usize::from(well);
        }
    }
    println!("{n} damaged files, {read_well} of them read");
    assert!(n > 100 && read_well < n);
}
