//! The written report in headless Chromium: values that a script measures in it, screenshots, prints.

use std::path::Path;

use cardiotwin_chromium::{Browser as Chromium, Look, Page};
use serde_json::Value;

/// A browser on this machine.
pub struct Browser(Chromium);

impl Browser {
    /// The browser, or `None` if none is installed. With `CI` set to `true` there must be one.
    pub fn find() -> Option<Self> {
        let found = Chromium::find();
        if found.is_none() {
            cardiotwin_not_tested::not_tested(
                "browser",
                "no Chromium in PATH; `make deps` installs it",
            );
        }
        found.map(Self)
    }

    /// Opens a file. `fragment` is empty, or begins with `#`; with ` dark` after it, the system prefers
    /// dark pages.
    pub fn open(&self, file: &Path, fragment: &str, (width, height): (u32, u32)) -> Page {
        let (fragment, dark) = match fragment.strip_suffix(" dark") {
            Some(fragment) => (fragment, true),
            None => (fragment, false),
        };
        let look = Look {
            width,
            height,
            dark,
        };
        let url = format!("file://{}{fragment}", file.display());
        self.0
            .open(&url, look)
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// Everything that a page writes to the console when it is opened, and its errors.
    pub fn complaints(&self, file: &Path, fragment: &str, window: (u32, u32)) -> Vec<String> {
        let mut page = self.open(file, fragment, window);
        // Timers and frames of the page's scripts may complain, too.
        page.value("new Promise((done) => setTimeout(() => requestAnimationFrame(done), 500))")
            .unwrap_or_else(|error| panic!("{error}"));
        page.complaints().expect("the browser answers").to_vec()
    }

    /// Value that a script returns in a page.
    pub fn measure(&self, file: &Path, fragment: &str, window: (u32, u32), script: &str) -> Value {
        self.open(file, fragment, window)
            .value(&format!("(async () => {{ {script} }})()"))
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// Prints a page to a PDF and returns the number of its sheets.
    pub fn printed(&self, file: &Path, fragment: &str, pdf: &Path) -> usize {
        let mut page = self.open(file, fragment, (1300, 2000));
        page.print(pdf).unwrap_or_else(|error| panic!("{error}"));
        let bytes = std::fs::read(pdf).expect("the PDF was just written");
        let text = String::from_utf8_lossy(&bytes);
        // Every sheet is an object of the type Page, and the list of them one of the type Pages.
        text.matches("/Type /Page").count() - text.matches("/Type /Pages").count()
    }
}
