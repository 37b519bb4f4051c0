//! Who may look, and what the server never does.

use std::collections::BTreeSet;

use crate::server::Dashboard;
use crate::support::Cohort;

#[test]
fn only_this_machine_and_only_with_the_token() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort.call(&["run"]).expect(0);
    let dashboard = Dashboard::start(cohort.path(), &[]);
    for path in [
        "/",
        "/app.js",
        "/api/live",
        "/api/patient/01-CoA",
        "/api/compare",
        "/none",
    ] {
        let answer = dashboard.ask(&format!("GET {path}"), &[]);
        assert_eq!(answer.status, 401, "{path} without a token");
        assert!(!answer.body.contains("01-CoA"), "{path}");
    }
    let wrong = format!("GET /?token={}", "0".repeat(64));
    assert_eq!(dashboard.ask(&wrong, &[]).status, 403);

    let cookie = dashboard.cookie();
    let page = dashboard.ask("GET /", &[&cookie]);
    assert_eq!(page.status, 200);
    let policy = page
        .head
        .lines()
        .find_map(|line| line.strip_prefix("content-security-policy: "))
        .expect("a policy");
    assert!(
        policy.starts_with("default-src 'none';") && !policy.contains("unsafe"),
        "{policy}"
    );
    assert!(!page.head.contains(&dashboard.token), "{}", page.head);
    for wanted in [
        "x-content-type-options: nosniff",
        "cache-control: no-store",
        "referrer-policy: no-referrer",
    ] {
        assert!(
            page.head.contains(wanted),
            "{wanted} is not in {}",
            page.head
        );
    }
    let patient = dashboard.ask("GET /api/patient/01-CoA", &[&cookie]);
    assert!(
        patient.status == 200 && patient.body.contains("<svg"),
        "{}",
        patient.head
    );
    let unknown = dashboard.ask("GET /api/patient/99-CoA", &[&cookie]);
    assert!(
        unknown.status == 404 && unknown.body.contains("01-CoA"),
        "{}",
        unknown.body
    );

    // A page of another site whose name points to this machine, and one with a name of its own.
    for host in [
        "Host: evil.example",
        "Host: 127.0.0.1.evil.example:80",
        "X: y",
    ] {
        assert_eq!(
            dashboard.send("GET /", &[host, &cookie]).status,
            403,
            "{host}"
        );
    }
    // A tunnel may begin at another port.
    assert_eq!(
        dashboard
            .send("GET /", &["Host: localhost:9999", &cookie])
            .status,
        200
    );
    for method in ["POST", "PUT", "DELETE"] {
        let answer = dashboard.ask(
            &format!("{method} /api/patient/01-CoA"),
            &[&cookie, "Content-Length: 0"],
        );
        assert_eq!(answer.status, 405, "{method}");
    }
    assert_eq!(dashboard.interrupt(), 0);
}

#[test]
fn nothing_else_listens_and_nothing_is_written() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort.call(&["run"]).expect(0);
    let files = || -> BTreeSet<_> {
        let entries = std::fs::read_dir(cohort.run_dir()).unwrap();
        entries
            .map(|entry| {
                let entry = entry.unwrap();
                (
                    entry.file_name(),
                    entry.metadata().unwrap().modified().unwrap(),
                )
            })
            // SQLite's memory for readers is not data.
            .filter(|(name, _)| {
                !name.to_string_lossy().ends_with("-shm")
                    && !name.to_string_lossy().ends_with("-wal")
            })
            .collect()
    };
    let before = files();
    let dashboard = Dashboard::start(cohort.path(), &[]);
    let cookie = dashboard.cookie();
    for path in ["/", "/api/patient/01-CoA", "/api/patient/01-CoA/log"] {
        assert_eq!(
            dashboard.ask(&format!("GET {path}"), &[&cookie]).status,
            200,
            "{path}"
        );
    }
    assert_eq!(listening(dashboard.pid()), [dashboard.address.as_str()]);
    assert_eq!(files(), before);
}

#[test]
fn a_run_that_is_not_there_and_a_port_that_is_taken() {
    let cohort = Cohort::quick_of("01-CoA");
    // A folder that is no cohort will never have a run.
    cohort
        .call(&["dashboard", "patients"])
        .expect(5)
        .complains_of(&["nothing was run here yet"]);
    cohort.call(&["run"]).expect(0);
    let dashboard = Dashboard::start(cohort.path(), &[]);
    let (_, port) = dashboard.address.split_once(':').unwrap();
    cohort
        .call(&["dashboard", "--port", port])
        .expect(6)
        .complains_of(&[&format!("cannot listen on 127.0.0.1:{port}")]);
}

/// Addresses on which a process listens, as Linux lists them.
fn listening(pid: u32) -> Vec<String> {
    let own: BTreeSet<String> = std::fs::read_dir(format!("/proc/{pid}/fd"))
        .unwrap()
        .filter_map(|entry| std::fs::read_link(entry.unwrap().path()).ok())
        .filter_map(|link| {
            let link = link.to_string_lossy().into_owned();
            Some(link.strip_prefix("socket:[")?.strip_suffix(']')?.to_owned())
        })
        .collect();
    let mut found = Vec::new();
    for table in ["tcp", "tcp6", "udp", "udp6"] {
        let text = std::fs::read_to_string(format!("/proc/{pid}/net/{table}")).unwrap_or_default();
        for line in text.lines().skip(1) {
            let words: Vec<&str> = line.split_whitespace().collect();
            // 0A: listening. A datagram socket has no such state.
            let listens = words[3] == "0A" || table.starts_with("udp");
            if listens && own.contains(words[9]) {
                found.push(address(words[1]));
            }
        }
    }
    found
}

/// `0100007F:1F90` as `127.0.0.1:8080`; others as they are.
fn address(text: &str) -> String {
    let Some((host, port)) = text.split_once(':').filter(|(host, _)| host.len() == 8) else {
        return text.to_owned();
    };
    let host = std::net::Ipv4Addr::from(u32::from_str_radix(host, 16).unwrap().to_le_bytes());
    format!("{host}:{}", u16::from_str_radix(port, 16).unwrap())
}

#[test]
fn long_addresses_and_requests_without_an_end_are_answered() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort.call(&["run", "--no-report"]).expect(0);
    let dashboard = Dashboard::start(cohort.path(), &[]);
    let cookie = dashboard.cookie();
    let long = "x".repeat(16 << 10);
    for path in [format!("/{long}"), format!("/api/patient/{long}")] {
        let answer = dashboard.ask(&format!("GET {path}"), &[&cookie]);
        assert_eq!(answer.status, 404, "{path:.20}");
    }
    // As curl 7.88 leaves it where a long address leaves no room for the cookie.
    let unfinished = format!(
        "GET /{long} HTTP/1.1\r\nHost: {}\r\nCookie: ",
        dashboard.address
    );
    let mut stream = std::net::TcpStream::connect(&dashboard.address).expect("it listens");
    std::io::Write::write_all(&mut stream, unfinished.as_bytes()).unwrap();
    let mut answer = String::new();
    std::io::Read::read_to_string(&mut stream, &mut answer).expect("an answer and the end");
    assert!(answer.starts_with("HTTP/1.1 408 "), "{answer}");
}
