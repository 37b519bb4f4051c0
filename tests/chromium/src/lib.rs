//! A headless Chromium, driven through its debugging pipe: pages are opened, clicked, measured and
//! photographed, and complain of what went wrong in them.
//!
//! Each page has a browser process and a profile of its own, like readers on different machines.

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use base64::Engine as _;
use serde_json::{Value, json};
use tempfile::TempDir;

/// Time limit far beyond the needs of a slow machine, which only a fault exceeds.
const PATIENCE: Duration = Duration::from_secs(120);

/// Description of what a browser did not do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageError(String);

impl std::fmt::Display for PageError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for PageError {}

fn failed(what: impl std::fmt::Display) -> impl FnOnce(std::io::Error) -> PageError {
    move |source| PageError(format!("{what}: {source}"))
}

/// A Chromium on this machine.
pub struct Browser {
    program: PathBuf,
}

/// Size and colours of a page.
#[derive(Debug, Clone, Copy)]
pub struct Look {
    /// Width of the page, px.
    pub width: u32,
    /// Height of the page, px.
    pub height: u32,
    /// Whether the system prefers dark pages.
    pub dark: bool,
}

/// A page in a browser process of its own, which ends with it.
pub struct Page {
    child: Child,
    to: ChildStdin,
    from: Receiver<Value>,
    session: String,
    n_sent: u64,
    complaints: Vec<String>,
    _profile: TempDir,
}

impl Browser {
    /// The first Chromium in `PATH`; `None` if there is none.
    #[must_use]
    pub fn find() -> Option<Self> {
        let names = [
            "chromium",
            "chromium-browser",
            "google-chrome",
            "google-chrome-stable",
        ];
        let path = std::env::var_os("PATH").unwrap_or_default();
        let program = std::env::split_paths(&path)
            .flat_map(|folder| names.map(|name| folder.join(name)))
            .find(|file| file.is_file())?;
        Some(Self { program })
    }

    /// Opens an address.
    ///
    /// # Errors
    /// [`PageError`] if the browser does not start or the page does not load.
    pub fn open(&self, url: &str, look: Look) -> Result<Page, PageError> {
        let profile = tempfile::tempdir().map_err(failed("cannot make a profile"))?;
        // The pipe has the numbers 3 and 4; a shell moves them there from the usual ones.
        let mut child = Command::new("sh")
            .args(["-c", "exec \"$0\" \"$@\" 3<&0 4>&1 0</dev/null 1>&2"])
            .arg(&self.program)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--hide-scrollbars",
                "--no-first-run",
                "--disable-dev-shm-usage",
                "--disable-background-networking",
                "--use-angle=swiftshader",
                "--enable-unsafe-swiftshader",
                "--remote-debugging-pipe",
            ])
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg("about:blank")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(failed("cannot start the browser"))?;
        let (Some(to), Some(mut out)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(PageError("the browser has no pipes".to_owned()));
        };
        let (tell, from) = channel();
        std::thread::spawn(move || {
            let (mut text, mut some) = (Vec::new(), [0; 1 << 16]);
            while let Ok(n @ 1..) = out.read(&mut some) {
                for byte in &some[..n] {
                    if *byte != 0 {
                        text.push(*byte);
                        continue;
                    }
                    let message = serde_json::from_slice(&text).unwrap_or_default();
                    text.clear();
                    if tell.send(message).is_err() {
                        return;
                    }
                }
            }
        });
        let mut page = Page {
            child,
            to,
            from,
            session: String::new(),
            n_sent: 0,
            complaints: Vec::new(),
            _profile: profile,
        };
        let target = page.call("Target.createTarget", json!({"url": "about:blank"}))?;
        let attached = page.call(
            "Target.attachToTarget",
            json!({"targetId": target["targetId"], "flatten": true}),
        )?;
        page.session = attached["sessionId"]
            .as_str()
            .unwrap_or_default()
            .to_owned();
        for domain in ["Page", "Runtime", "Log"] {
            page.call(&format!("{domain}.enable"), json!({}))?;
        }
        page.look(look)?;
        page.go(url)?;
        Ok(page)
    }
}

impl Page {
    /// Calls a method of the DevTools protocol and returns its result.
    ///
    /// # Errors
    /// [`PageError`] with the browser's words, or if it does not answer.
    pub fn call(&mut self, method: &str, params: Value) -> Result<Value, PageError> {
        self.n_sent += 1;
        let id = self.n_sent;
        let mut message = json!({"id": id, "method": method, "params": params});
        if !self.session.is_empty() {
            message["sessionId"] = self.session.clone().into();
        }
        let text = format!("{message}\0");
        self.to
            .write_all(text.as_bytes())
            .map_err(failed("the browser has ended"))?;
        let until = Instant::now() + PATIENCE;
        loop {
            let answer = self.receive(until, method)?;
            if answer["id"] == id {
                return match answer.get("error") {
                    None => Ok(answer["result"].clone()),
                    Some(error) => Err(PageError(format!("{method}: {error}"))),
                };
            }
        }
    }

    fn receive(&mut self, until: Instant, what: &str) -> Result<Value, PageError> {
        let left = until.saturating_duration_since(Instant::now());
        let message = self.from.recv_timeout(left).map_err(|error| {
            PageError(match error {
                RecvTimeoutError::Timeout => format!("the browser never answered {what}"),
                RecvTimeoutError::Disconnected => format!("the browser ended at {what}"),
            })
        })?;
        let params = &message["params"];
        match message["method"].as_str() {
            Some("Runtime.consoleAPICalled") => {
                self.complaints.push(params["args"].to_string());
            }
            Some("Runtime.exceptionThrown") => {
                self.complaints.push(params["exceptionDetails"].to_string());
            }
            Some("Log.entryAdded")
                if matches!(params["entry"]["level"].as_str(), Some("error" | "warning")) =>
            {
                self.complaints.push(params["entry"].to_string());
            }
            _ => {}
        }
        Ok(message)
    }

    /// Goes to an address and waits until it has loaded.
    ///
    /// # Errors
    /// [`PageError`] if nothing answers there.
    pub fn go(&mut self, url: &str) -> Result<(), PageError> {
        let went = self.call("Page.navigate", json!({"url": url}))?;
        if let Some(error) = went["errorText"].as_str() {
            return Err(PageError(format!("{url}: {error}")));
        }
        self.wait_for("document.readyState === 'complete' && location.href !== 'about:blank'")
            .map(drop)
    }

    /// Sets the page's size and colours.
    ///
    /// # Errors
    /// [`PageError`] if the browser does not answer.
    pub fn look(&mut self, look: Look) -> Result<(), PageError> {
        let size = json!({"width": look.width, "height": look.height, "deviceScaleFactor": 1, "mobile": false});
        self.call("Emulation.setDeviceMetricsOverride", size)?;
        let value = if look.dark { "dark" } else { "light" };
        let scheme = json!({"features": [{"name": "prefers-color-scheme", "value": value}]});
        self.call("Emulation.setEmulatedMedia", scheme).map(drop)
    }

    /// Value of an expression in the page; a promise is waited for.
    ///
    /// # Errors
    /// [`PageError`] with the exception.
    pub fn value(&mut self, expression: &str) -> Result<Value, PageError> {
        let params = json!({"expression": expression, "awaitPromise": true, "returnByValue": true});
        let found = self.call("Runtime.evaluate", params)?;
        match found.get("exceptionDetails") {
            None => Ok(found["result"]["value"].clone()),
            Some(details) => Err(PageError(format!("{expression}: {details}"))),
        }
    }

    /// Waits until an expression is true in the sense of JavaScript, and returns its value.
    ///
    /// # Errors
    /// [`PageError`] with the page's text if it never is.
    pub fn wait_for(&mut self, expression: &str) -> Result<Value, PageError> {
        let until = Instant::now() + PATIENCE;
        loop {
            let value = self.value(expression)?;
            let is_true = match &value {
                Value::Null | Value::Bool(false) => false,
                Value::String(text) => !text.is_empty(),
                Value::Number(number) => number.as_f64() != Some(0.0),
                _ => true,
            };
            if is_true {
                return Ok(value);
            }
            if Instant::now() > until {
                let text = self.value("document.body.innerText")?;
                return Err(PageError(format!("never true: {expression}; page: {text}")));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Presses and releases the mouse in the middle of the first element that a selector finds, at
    /// the place where a reader would.
    ///
    /// # Errors
    /// [`PageError`] if there is no such element, or if another one covers it.
    pub fn click(&mut self, selector: &str) -> Result<(), PageError> {
        let quoted = Value::from(selector);
        self.wait_for(&format!(
            "document.querySelector({quoted})?.getBoundingClientRect().width > 0"
        ))?;
        let place = self.value(&format!(
            "(() => {{ const e = document.querySelector({quoted}); e.scrollIntoView({{block: 'nearest'}}); \
             const r = e.getBoundingClientRect(), x = r.x + r.width / 2, y = r.y + r.height / 2; \
             const top = document.elementFromPoint(x, y); return {{x, y, free: e === top || e.contains(top)}}; }})()"
        ))?;
        if place["free"] != true {
            return Err(PageError(format!("{selector} is covered")));
        }
        for kind in ["mouseMoved", "mousePressed", "mouseReleased"] {
            let event = json!({"type": kind, "x": place["x"], "y": place["y"], "button": "left", "clickCount": 1});
            self.call("Input.dispatchMouseEvent", event)?;
        }
        Ok(())
    }

    /// Types text into the focused element.
    ///
    /// # Errors
    /// [`PageError`] if the browser does not answer.
    pub fn write(&mut self, text: &str) -> Result<(), PageError> {
        self.call("Input.insertText", json!({"text": text}))
            .map(drop)
    }

    /// Presses a key, named as in DOM events.
    ///
    /// # Errors
    /// [`PageError`] if the browser does not answer.
    pub fn press(&mut self, key: &str) -> Result<(), PageError> {
        for kind in ["keyDown", "keyUp"] {
            self.call("Input.dispatchKeyEvent", json!({"type": kind, "key": key}))?;
        }
        Ok(())
    }

    /// Writes a picture of the page as PNG.
    ///
    /// # Errors
    /// [`PageError`] if there is no picture or the file cannot be written.
    pub fn photograph(&mut self, file: &Path) -> Result<(), PageError> {
        let shot = self.call("Page.captureScreenshot", json!({"format": "png"}))?;
        write_decoded(file, &shot)
    }

    /// Prints the page to a PDF file, with the page's own print style.
    ///
    /// # Errors
    /// [`PageError`] if nothing is printed or the file cannot be written.
    pub fn print(&mut self, file: &Path) -> Result<(), PageError> {
        let how = json!({"printBackground": true, "preferCSSPageSize": true});
        let printed = self.call("Page.printToPDF", how)?;
        write_decoded(file, &printed)
    }

    /// Complaints of the page so far: all that it wrote to the console, exceptions, refused and
    /// failed requests.
    ///
    /// # Errors
    /// [`PageError`] if the browser does not answer.
    pub fn complaints(&mut self) -> Result<&[String], PageError> {
        // What came before the answer has been heard by then.
        self.value("1")?;
        Ok(&self.complaints)
    }
}

/// Writes the `data` of an answer, which is base64.
fn write_decoded(file: &Path, answer: &Value) -> Result<(), PageError> {
    let bytes = base64::engine::general_purpose::STANDARD
        .decode(answer["data"].as_str().unwrap_or_default())
        .map_err(|error| PageError(error.to_string()))?;
    std::fs::write(file, bytes).map_err(failed(file.display()))
}

impl Drop for Page {
    fn drop(&mut self) {
        self.session.clear();
        // The browser ends its own children; killed, it would leave them.
        let _ = self.call("Browser.close", json!({}));
        let until = Instant::now() + Duration::from_secs(10);
        while Instant::now() < until {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
