//! Headless Chromium: opens a page and returns its messages, the values that a script measures in
//! it, or a screenshot.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

/// A browser on this machine.
pub struct Browser {
    program: PathBuf,
}

/// Result of a visit.
pub struct Visit {
    /// The page after its scripts have run.
    pub dom: String,
    /// Lines that the page wrote to the console, including errors.
    pub console: Vec<String>,
}

impl Browser {
    /// The browser, or `None` if none is installed. With `CI` set to `true` there must be one.
    pub fn find() -> Option<Self> {
        let found = cardiotwin_chromium::Browser::find();
        if found.is_none() {
            cardiotwin_not_tested::not_tested(
                "browser",
                "no Chromium in PATH; `make deps` installs it",
            );
        }
        found.map(|browser| Self {
            program: browser.program().to_owned(),
        })
    }

    /// Opens a page (`file`, with a fragment) and returns its DOM and console.
    pub fn visit(&self, file: &Path, fragment: &str, window: (u32, u32)) -> Visit {
        let (out, err) = self.run(file, fragment, window, &["--dump-dom"]);
        let console = err
            .lines()
            .filter(|l| l.contains("CONSOLE"))
            .map(str::to_owned)
            .collect();
        Visit { dom: out, console }
    }

    /// Opens a page with an appended script and returns the script's value.
    pub fn measure(&self, file: &Path, fragment: &str, window: (u32, u32), script: &str) -> Value {
        let page = std::fs::read_to_string(file).expect("the page was just written");
        let copy = file.with_extension("measured.html");
        let script = format!(
            "<script>(async () => {{ {script} }})().catch((error) => `error: ${{error}}`).then((value) => {{ const e = document.createElement('pre'); e.id = 'measured'; \
             e.textContent = '@@' + encodeURIComponent(JSON.stringify(value)) + '@@'; document.body.append(e); }})</script>"
        );
        std::fs::write(
            &copy,
            page.replacen("</body>", &format!("{script}</body>"), 1),
        )
        .expect("the folder takes files");
        let visit = self.visit(&copy, fragment, window);
        let coded = visit
            .dom
            .rsplit("@@")
            .nth(1)
            .filter(|_| visit.dom.contains("id=\"measured\""));
        let coded = coded
            .unwrap_or_else(|| panic!("the script left no value; console: {:?}", visit.console));
        serde_json::from_slice(&percent_decoded(coded)).expect("the script's value is JSON")
    }

    /// Prints a page to a PDF and returns the number of its sheets.
    pub fn printed(&self, file: &Path, fragment: &str, pdf: &Path) -> usize {
        let to = format!("--print-to-pdf={}", pdf.display());
        let (_, err) = self.run(
            file,
            fragment,
            (1300, 2000),
            &[&to, "--no-pdf-header-footer"],
        );
        let bytes = std::fs::read(pdf).unwrap_or_else(|error| panic!("no PDF, {error}: {err}"));
        let text = String::from_utf8_lossy(&bytes);
        // Every sheet is an object of the type Page, and the list of them one of the type Pages.
        text.matches("/Type /Page").count() - text.matches("/Type /Pages").count()
    }

    /// Takes a screenshot as PNG.
    pub fn screenshot(&self, file: &Path, fragment: &str, window: (u32, u32), png: &Path) {
        let (_, err) = self.run(
            file,
            fragment,
            window,
            &[&format!("--screenshot={}", png.display())],
        );
        assert!(png.exists(), "no screenshot was taken: {err}");
    }

    fn run(
        &self,
        file: &Path,
        fragment: &str,
        (width, height): (u32, u32),
        what: &[&str],
    ) -> (String, String) {
        let profile = tempfile::tempdir().expect("a folder for the browser's profile");
        // Output goes to files instead of pipes: a browser that fills a pipe while it is not read
        // would never end.
        let (out, err) = (
            profile.path().join("out.txt"),
            profile.path().join("err.txt"),
        );
        let create = |path: &Path| {
            Stdio::from(std::fs::File::create(path).expect("a temporary folder takes files"))
        };
        let mut child = Command::new(&self.program)
            .args([
                "--headless",
                "--no-sandbox",
                // Software rendering, so that pages can use WebGL without a graphics card.
                "--use-gl=angle",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--hide-scrollbars",
                "--disable-background-networking",
            ])
            .args([
                "--disable-dev-shm-usage",
                "--no-first-run",
                "--enable-logging=stderr",
                "--v=0",
                "--virtual-time-budget=20000",
            ])
            .arg(format!(
                "--user-data-dir={}",
                profile.path().join("profile").display()
            ))
            .arg(format!("--window-size={width},{height}"))
            .args(what)
            .arg(format!("file://{}{fragment}", file.display()))
            .stdout(create(&out))
            .stderr(create(&err))
            .spawn()
            .expect("the browser starts");
        let deadline = Instant::now() + Duration::from_secs(600);
        let ended = loop {
            match child.try_wait().expect("a child can be waited for") {
                Some(status) => break Some(status),
                None if Instant::now() > deadline => break None,
                None => std::thread::sleep(Duration::from_millis(20)),
            }
        };
        if ended.is_none() {
            let _ = child.kill();
            let _ = child.wait();
        }
        let read = |path: &Path| {
            String::from_utf8_lossy(&std::fs::read(path).unwrap_or_default()).into_owned()
        };
        let (out, err) = (read(&out), read(&err));
        assert!(
            ended.is_some_and(|s| s.success()),
            "the browser did not end well ({ended:?}): {err}"
        );
        (out, err)
    }
}

fn percent_decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let code = (bytes[i] == b'%')
            .then(|| u8::from_str_radix(&text[i + 1..i + 3], 16).expect("two hex digits"));
        decoded.push(code.unwrap_or(bytes[i]));
        i += if code.is_some() { 3 } else { 1 };
    }
    decoded
}

/// Base64 encoding, for a `data:` address.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len() / 3 * 4 + 4);
    for group in bytes.chunks(3) {
        let word = group
            .iter()
            .enumerate()
            .fold(0_u32, |word, (i, b)| word | u32::from(*b) << (16 - 8 * i));
        for k in 0..4 {
            let digit = char::from(DIGITS[(word >> (18 - 6 * k)) as usize & 63]);
            text.push(if k <= group.len() { digit } else { '=' });
        }
    }
    text
}
