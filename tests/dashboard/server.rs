//! A running `cardiotwin dashboard`, and plain requests to it.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Stdio};

use crate::support::command;

/// A dashboard, which ends with it.
pub struct Dashboard {
    child: Child,
    /// The address that it printed.
    pub url: String,
    /// `127.0.0.1:PORT`.
    pub address: String,
    /// The secret in the address.
    pub token: String,
}

/// Answer to a request.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: String,
}

impl Dashboard {
    /// Starts the dashboard of a cohort and waits for its address.
    pub fn start(folder: &Path, arguments: &[&str]) -> Self {
        let mut all = vec!["dashboard"];
        all.extend(arguments);
        let mut child = command(folder, &all)
            .stdout(Stdio::piped())
            .stderr(Stdio::inherit())
            .spawn()
            .expect("the program starts");
        let mut url = String::new();
        BufReader::new(child.stdout.take().expect("a pipe"))
            .read_line(&mut url)
            .expect("the address is text");
        let url = url.trim().to_owned();
        let rest = url.strip_prefix("http://").expect("an address");
        let (address, token) = rest.split_once("/?token=").expect("a token");
        Self {
            address: address.to_owned(),
            token: token.to_owned(),
            url,
            child,
        }
    }

    /// Id of the process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends a request with these lines of its head next to the host's.
    pub fn ask(&self, line: &str, head: &[&str]) -> Answer {
        let host = format!("Host: {}", self.address);
        let lines: Vec<&str> = std::iter::once(host.as_str())
            .chain(head.iter().copied())
            .collect();
        self.send(line, &lines)
    }

    /// Sends a request with exactly these lines of its head.
    pub fn send(&self, line: &str, head: &[&str]) -> Answer {
        let mut stream = TcpStream::connect(&self.address).expect("it listens");
        let request = format!(
            "{line} HTTP/1.1\r\n{}\r\nConnection: close\r\n\r\n",
            head.join("\r\n")
        );
        stream.write_all(request.as_bytes()).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        let (head, body) = text.split_once("\r\n\r\n").expect("an answer");
        Answer {
            status: head.split(' ').nth(1).unwrap().parse().unwrap(),
            head: head.to_ascii_lowercase(),
            body: body.to_owned(),
        }
    }

    /// The line of a request's head that carries the token, from the answer to the first address.
    pub fn cookie(&self) -> String {
        let first = self.ask(&format!("GET /?token={}", self.token), &[]);
        assert_eq!(first.status, 303, "{}", first.head);
        let set = first
            .head
            .lines()
            .find_map(|line| line.strip_prefix("set-cookie: "))
            .expect("a cookie");
        for wanted in ["httponly", "samesite=strict"] {
            assert!(set.contains(wanted), "{set}");
        }
        format!("Cookie: {}", set.split(';').next().unwrap())
    }

    /// Ends it as Ctrl-C does, and returns its exit code.
    pub fn interrupt(mut self) -> i32 {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("it is running");
        self.child
            .wait()
            .expect("our own child")
            .code()
            .unwrap_or(-1)
    }
}

impl Drop for Dashboard {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
