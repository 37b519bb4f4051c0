//! Damaged files: every reader refuses them or reads them, without a panic, within 1 GiB of memory and
//! within 10 s each.
//!
//! The files are read in a child process of this program under a limit of its address space, so that a
//! reader that believes a damaged count ends there, and the file is named. `-- --ignored` (a part of
//! `make test-long`) damages each file far more often.

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use cardiotwin_lab_files::{Request, Wanted, read};
use cardiotwin_mesh::files::{self, LengthUnit};
use rustix::process::{Resource, Rlimit, setrlimit};

/// Longest time for one file. A damaged count must not make a reader continue for ever.
const LONGEST: Duration = Duration::from_secs(10);
/// Address space in which every file is read.
const MEMORY_BYTES: u64 = 1 << 30;
/// Name of the variable that tells the child how often each file is damaged.
const CHILD: &str = "CARDIOTWIN_DAMAGED_ROUNDS";
/// Exit code of a child in which one file took too long.
const TOO_LONG: i32 = 3;
/// How often each file is damaged at random, in the usual test and in the long one.
const ROUNDS: [usize; 2] = [4, 60];
/// Replaced numbers of its header for each of these rounds.
const COUNTS_PER_ROUND: usize = 8;
/// What a number of a text, or a word of a binary header, is replaced by.
const COUNTS: [&[u8]; 4] = [b"4294967295", b"99999999999", b"-1", b"1000000000"];

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

/// A copy in which one of its numbers is another: `k` counts numbers and replacements. `None` beyond the
/// last number of the header.
fn with_a_count(bytes: &[u8], k: usize) -> Option<Vec<u8>> {
    let (number, with) = (k / (COUNTS.len() + 1), k % (COUNTS.len() + 1));
    let mut runs = Vec::new();
    let mut at = 0;
    while at < bytes.len().min(4000) {
        let n = bytes[at..]
            .iter()
            .take_while(|byte| byte.is_ascii_digit())
            .count();
        if n > 0 {
            runs.push(at..at + n);
        }
        at += n.max(1);
    }
    let run = runs.get(number)?.clone();
    let mut out = bytes.to_vec();
    match COUNTS.get(with) {
        Some(word) => drop(out.splice(run, word.iter().copied())),
        // Of the same length, for formats whose fields have places.
        None => out[run].fill(b'9'),
    }
    Some(out)
}

fn sources() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mut folders: Vec<PathBuf> = [
        "tests/fixtures/public-reports",
        "solver/lab-files/tests/data",
        "solver/mesh/tests/data",
    ]
    .map(|folder| root.join(folder))
    .into();
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if is_read(&path) {
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

/// Whether a reader takes files of this ending.
fn is_read(path: &Path) -> bool {
    const ENDINGS: [&str; 13] = [
        "csv", "txt", "xlsx", "edf", "bdf", "hea", "dat", "vtu", "msh", "elem", "pts", "lon",
        "surf",
    ];
    ENDINGS.contains(&ending(path))
}

/// Whether the content is read as the file would be; what is not read must be said.
fn is_taken(path: &Path, content: Vec<u8>, folder: &Path) -> bool {
    match ending(path) {
        "vtu" => files::vtu::parse(&content, path, LengthUnit::Millimetre).is_ok(),
        "msh" => String::from_utf8(content)
            .is_ok_and(|text| files::gmsh::parse(&text, path, LengthUnit::Millimetre).is_ok()),
        "elem" | "pts" | "lon" | "surf" => {
            for entry in std::fs::read_dir(path.parent().unwrap()).unwrap() {
                let from = entry.unwrap().path();
                std::fs::copy(&from, folder.join(from.file_name().unwrap())).unwrap();
            }
            std::fs::write(folder.join(path.file_name().unwrap()), &content).unwrap();
            files::read(&folder.join("heart"), LengthUnit::Micrometre).is_ok()
        }
        // The samples of a record are read by its sound header.
        "dat" => {
            let files = std::fs::read_dir(path.parent().unwrap()).unwrap();
            let name = path.file_name().and_then(|name| name.to_str()).unwrap();
            let header = files
                .map(|entry| entry.unwrap().path())
                .filter(|file| ending(file) == "hea")
                .find(|file| std::fs::read_to_string(file).unwrap().contains(name))
                .unwrap();
            let bytes = std::fs::read(&header).unwrap();
            table(&header, &bytes, Some((path, &content)))
        }
        _ => table(path, &content, None),
    }
}

/// Whether a table is read; `beside` is a file next to it with another content.
fn table(path: &Path, content: &[u8], beside: Option<(&Path, &[u8])>) -> bool {
    let wanted = [
        Wanted::required("time"),
        Wanted::new("lv_pressure"),
        Wanted::new("aortic_pressure"),
        Wanted::new("ecg"),
        Wanted::new("volume"),
    ];
    let request = Request {
        file: path,
        wanted: &wanted,
        format: None,
        sheet: None,
        block: None,
    };
    let folder = path.parent().unwrap();
    let mut others = |name: &str| match beside {
        Some((other, content)) if other == folder.join(name) => Ok(content.to_vec()),
        _ => std::fs::read(folder.join(name)).map_err(|error| error.to_string()),
    };
    let reading = read(content, &request, &mut others);
    assert!(
        reading.table.is_some() || !reading.problems.is_empty(),
        "{} is not read, and nothing is said",
        path.display()
    );
    reading.table.is_some()
}

/// What the child is at: since when, and which file.
static AT: Mutex<Option<(Instant, String)>> = Mutex::new(None);

/// Reads all damaged files under the limits. A panic of a reader ends it.
fn read_under_limits(rounds: usize) {
    let limit = Rlimit {
        current: Some(MEMORY_BYTES),
        maximum: Some(MEMORY_BYTES),
    };
    setrlimit(Resource::As, limit).unwrap();
    assert!(
        Vec::<u8>::new()
            .try_reserve_exact(MEMORY_BYTES as usize)
            .is_err(),
        "the limit holds"
    );
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(Duration::from_millis(100));
            let at = AT.lock().unwrap();
            if let Some((_, name)) = at.as_ref().filter(|(began, _)| began.elapsed() > LONGEST) {
                eprintln!("{name}: more than {LONGEST:?}");
                std::process::exit(TOO_LONG);
            }
        }
    });
    let mut random = Random(0x5eed_1234_abcd);
    let (mut n, mut read_well, mut longest) = (0, 0, Duration::ZERO);
    let folder = tempfile::tempdir().unwrap();
    let trace = std::env::var_os(TRACE).map(PathBuf::from).unwrap();
    for path in sources() {
        let bytes = std::fs::read(&path).unwrap();
        let at_random: Vec<Vec<u8>> = (0..rounds).map(|_| damaged(&bytes, &mut random)).collect();
        let of_counts = (0..rounds * COUNTS_PER_ROUND).map_while(|k| with_a_count(&bytes, k));
        for (k, content) in at_random.into_iter().chain(of_counts).enumerate() {
            let name = format!("{} damaged for the {k}th time", path.display());
            // The parent names the file if this process ends in it.
            std::fs::write(&trace, &name).unwrap();
            let began = Instant::now();
            *AT.lock().unwrap() = Some((began, name));
            let well = is_taken(&path, content, folder.path());
            *AT.lock().unwrap() = None;
            longest = longest.max(began.elapsed());
            n += 1;
            read_well += usize::from(well);
        }
    }
    println!(
        "{n} damaged files, {read_well} of them read, {} ms the longest, under {} MiB",
        longest.as_millis(),
        MEMORY_BYTES >> 20
    );
    assert!(n > 300 && read_well < n);
}

/// Name of the variable with the file into which the child writes what it is at.
const TRACE: &str = "CARDIOTWIN_DAMAGED_TRACE";

fn main() -> ExitCode {
    if let Some(rounds) = std::env::var(CHILD).ok().and_then(|n| n.parse().ok()) {
        read_under_limits(rounds);
        return ExitCode::SUCCESS;
    }
    let is_long = std::env::args().any(|a| a == "--ignored");
    let name = "no damage makes a reader panic, go on, or fill the memory";
    if std::env::args().any(|a| a == "--list") {
        println!("{name}: test");
        return ExitCode::SUCCESS;
    }
    let trace = tempfile::NamedTempFile::new().unwrap();
    let output = Command::new(std::env::current_exe().unwrap())
        .env(CHILD, ROUNDS[usize::from(is_long)].to_string())
        .env(TRACE, trace.path())
        .output()
        .unwrap();
    print!("{}", String::from_utf8_lossy(&output.stdout));
    if output.status.success() {
        println!("test {name} ... ok\ntest result: ok. 1 passed; 0 failed");
        return ExitCode::SUCCESS;
    }
    let at = std::fs::read_to_string(trace.path()).unwrap_or_default();
    println!(
        "test {name} ... FAILED\n{}, at {at}\n{}\ntest result: FAILED. 0 passed; 1 failed",
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    ExitCode::FAILURE
}
