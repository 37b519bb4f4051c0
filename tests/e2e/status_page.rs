//! The terminal page of `status --watch`, on a pseudo-terminal made by util-linux's `script`.

use std::io::{Read as _, Write as _};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use crate::support::{Cohort, binary};

/// Time limit far beyond the needs of a slow machine, which only a fault exceeds.
const PATIENCE: Duration = Duration::from_secs(120);

/// The terminal as a person sees it.
struct Screen {
    from: Receiver<Vec<u8>>,
    terminal: vt100::Parser,
}

impl Screen {
    /// Waits until a text stands on the screen, and until another one does not.
    #[track_caller]
    fn wait_for(&mut self, wanted: &str, unwanted: &str) {
        let until = Instant::now() + PATIENCE;
        loop {
            let seen = self.terminal.screen().contents();
            if seen.contains(wanted) && (unwanted.is_empty() || !seen.contains(unwanted)) {
                return;
            }
            let left = until.saturating_duration_since(Instant::now());
            match self.from.recv_timeout(left) {
                Ok(bytes) => self.terminal.process(&bytes),
                Err(error) => panic!("{error}: {wanted:?}, but not {unwanted:?}, in\n{seen}"),
            }
        }
    }
}

#[test]
fn keys_open_a_patient_and_its_log_and_the_terminal_is_given_back() {
    let cohort = Cohort::quick();
    cohort.call(&["run", "--quiet"]).expect(0);
    let call = format!(
        "stty rows 40 cols 150; exec {} status --watch",
        binary("cardiotwin").display()
    );
    let mut child = Command::new("script")
        .args(["--quiet", "--return", "--command", &call, "/dev/null"])
        .current_dir(cohort.path())
        .env("TERM", "xterm-256color")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("util-linux's `script` starts");
    let mut keys = child.stdin.take().expect("a pipe");
    let mut out = child.stdout.take().expect("a pipe");
    let (tell, from) = channel();
    std::thread::spawn(move || {
        let mut some = [0; 4096];
        while let Ok(n @ 1..) = out.read(&mut some) {
            if tell.send(some[..n].to_vec()).is_err() {
                return;
            }
        }
    });
    let mut screen = Screen {
        from,
        terminal: vt100::Parser::new(40, 150, 0),
    };
    let mut press = |pressed: &str| {
        keys.write_all(pressed.as_bytes()).expect("it listens");
        keys.flush().expect("it listens");
    };
    screen.wait_for("2 of 2: by state", "");
    assert!(screen.terminal.screen().alternate_screen());
    press("\r");
    screen.wait_for("01-CoA: results", "2 of 2");
    screen.wait_for("P_max_mmHg", "");
    press("\t");
    screen.wait_for("01-CoA: log of the last attempt", "P_max_mmHg");
    press("q");
    screen.wait_for("Enter open", "log of the last attempt");
    press("/02\r");
    screen.wait_for("1 of 2: by state, with \"02\"", "01-CoA");
    press("q");
    // The page is gone, and the table stays.
    screen.wait_for("TIME IN STATE", "Enter open");
    screen.wait_for("2 done", "");
    assert!(!screen.terminal.screen().alternate_screen());
    assert!(child.wait().expect("it ends").success());
}
